"""Hold a print for inspection until a client or the operator decides; park the needle meanwhile.

A look is held as a pause is: nothing in flight, motors at rest, place compared, valve shut or
plunger relieved, needle out of the bath. It ends by a decision: go on, pause, stop. Where none
comes within ``look_limit_s`` it becomes a pause for the operator, with an alarm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.look_book import (
    Answer,
    Look,
    LookDecision,
    LookRequest,
    decision_answer,
)
from printctl.machine.control.printing.context import Print
from printctl.machine.control.printing.others import own_modes
from printctl.machine.control.printing.pausing import (
    await_word,
    come_back,
    leave,
    pause_where_due,
    sign_of_life,
    wait_and_come_back,
)
from printctl.machine.control.printing.syringes import begin_change
from printctl.machine.control.requests import Request, ResumeRequest
from printctl.machine.control.watch import DueTask
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState

OBSERVER: Final = "the observer"
ABOVE_MM: Final = 5.0
"""Kept above the job's greatest height on the way across to the parking place."""
ACROSS_MM_S: Final = 20.0

Park = tuple[float, float, float]


@dataclass(frozen=True)
class _Ending:
    """End of a look: decision, reason, whose; whether a syringe is changed, or the look failed.

    A client is given its answer by ``confirm`` once the decision is in the journal.
    """

    decision: LookDecision
    why: str
    by: str
    changing: bool = False
    again: bool = False
    confirm: Callable[[Answer], None] = lambda answer: None


_AGAIN: Final = _Ending(LookDecision.PAUSE, "a pause was requested", "the user", again=True)
_BY_REQUEST: Final = {
    Request.PAUSE: _AGAIN,
    Request.RELOAD: replace(_AGAIN, why="a syringe change was requested", changing=True),
}
_RESUMED: Final = _Ending(LookDecision.GO_ON, "the operator's decision (resume)", "the user")


def restore_looks(run: Print, history: JournalledPrint, done: int) -> None:
    """Take up what a process that died has written down of looks; ``done`` lines are taken."""
    watch, looked = run.watch, history.looked
    run.book.restore(looked, history.inserts)
    if looked:
        watch.looked(run.channel.now, int(looked[-1]["done"]))
    for one in history.inserts:
        end = one.after + len(one.lines)
        if one.again and done <= end and all(int(each["done"]) != end for each in looked):
            watch.insert_end = end
    undecided = history.look is not None and int(history.look["done"]) == done
    # died in a pause that came of a look here: what that waited for is asked again
    still_paused = (
        bool(looked)
        and history.state in (LinkState.PAUSING, LinkState.PAUSED)
        and looked[-1]["decision"] == LookDecision.PAUSE
        and int(looked[-1]["done"]) == done
    )
    if undecided or still_paused:
        watch.look_again = True


def do_what_is_due(run: Print) -> Steps[None]:
    """Do what is due after the lines that were taken, looks first; nothing is in flight."""
    progress = run.progress
    while run.watch.due(run.channel.now, progress.done) is DueTask.LOOK:
        yield from _look(run)
    if progress.done < len(progress.job):
        yield from pause_where_due(run)


def _look(run: Print) -> Steps[None]:
    """Leave the bath, wait for a decision, and do as it says; raise `StopRequested` for a stop."""
    watch, done = run.watch, run.progress.done
    usual = "end of a line within a layer"
    if watch.is_behind_insert(done):
        usual = "end of the injected G-code"
    here = ", ".join(map(str, run.job.marks.here(done))) or usual
    layer = run.job.marks.last(MarkKind.LAYER, done)
    number = -1 if layer is None else layer.number
    look = run.book.begin(done, here, number, run.wiring.wall_s(), watch.care.look_limit_s)
    run.logbook.record("look", look=look.number, done=done, mark=look.mark, layer=look.layer)
    park = _park_place(run, watch.care.look_park_mm)
    at = yield from leave(run, "look", park=park)
    watch.checked(run.channel.now, done)
    if park is not None:
        yield from run.position.refuse_elsewhere(at.x, at.y, at.z)
        yield from lead_needle(run, at, park, back=False)
    run.logbook.enter(LinkState.LOOKING, f"held for {look}: waiting for a decision")
    run.excursion.rests = True
    ending = yield from _decide(run, at, look)
    if ending.decision is LookDecision.STOP:
        run.queue.add(Request.STOP, by=ending.by)
        raise StopRequested
    changes = run.change.begun
    yield from _leave_look(run, at, park, look, ending)
    changed = run.change.begun > changes and look.number not in run.book.inserts
    if (changed or _is_made_again(run, look, ending)) and not watch.unobserved:
        watch.look_again = True


def _is_made_again(run: Print, look: Look, ending: _Ending) -> bool:
    """Whether a look that failed is made once more; one that failed twice isn't."""
    return ending.again and not run.book.failed_before(look)


def _leave_look(
    run: Print, at: Modal, park: Park | None, look: Look, ending: _Ending
) -> Steps[None]:
    """Come back above the job's place; go on, or stay for the operator."""
    goes_on, words = ending.decision is LookDecision.GO_ON, "returning to the print position"
    if not goes_on:
        then = "continues unchanged" if ending.by == OBSERVER else "continues"
        if _is_made_again(run, look, ending):
            then = "repeats this look (with --unobserved it continues without)"
        elif ending.again:
            then = "continues without this look"
        words = f"paused at {look}: {ending.why}; `printctl resume RUN` {then}"
    if goes_on or park is not None:
        run.logbook.enter(LinkState.RESUMING if goes_on else LinkState.PAUSING, words)
        run.excursion.come_back((yield from run.position.height()))
    if park is not None:
        yield from own_modes(run)
        yield from run.position.refuse_elsewhere(*park)
        yield from lead_needle(run, at, park, back=True)
    if goes_on:
        yield from come_back(run, at, by_person=ending.by != OBSERVER)
        return
    if ending.changing:
        run.change.planned_head = run.change.wanted_head
        yield from begin_change(run, at)
        words = run.change.words(run.printer)
    yield from wait_and_come_back(run, at, words)


def _decide(run: Print, at: Modal, look: Look) -> Steps[_Ending]:
    """Wait for a decision and write it down; an alarm where a person must know of it."""
    ending = yield from _await_decision(run, at, look.limit_s)
    decision = {"decision": str(ending.decision), "why": ending.why, "by": ending.by}
    failed = {"again": True} if ending.again else {}
    record = {"look": look.number, "done": look.done, **decision, **failed}
    run.logbook.record("looked", **record)
    run.book.decisions[look.number] = record
    run.watch.looked(run.channel.now, look.done)
    if ending.decision is not LookDecision.GO_ON and ending.by != "the user":
        run.logbook.alarm(f"{look}: {ending.by} decided to {ending.decision}: {ending.why}")
    run.channel.tell(ending.confirm, decision_answer(record))
    return ending


def _await_decision(run: Print, at: Modal, limit_s: float) -> Steps[_Ending]:
    until_s = run.channel.now + limit_s
    while (word := (yield from await_word(run, at, until_s))) is not None:
        if isinstance(word, LookRequest) and word.decision is not None:
            failed = word.again and word.decision is LookDecision.PAUSE
            return _Ending(word.decision, word.why, OBSERVER, again=failed, confirm=word.done)
        if isinstance(word, ResumeRequest):
            run.channel.tell(word.answer, "")
            return _RESUMED
        if word in _BY_REQUEST:
            return _BY_REQUEST[word]
        yield from sign_of_life(run)
    why = f"no decision within {limit_s:g} s (look_limit_s): the observer hangs or has exited"
    return _Ending(LookDecision.PAUSE, why, "the link", again=True)


def refuse_park(park: Park | None, printer: Printer) -> None:
    """Refuse a parking place, mm, that the machine doesn't reach."""
    for axis, mm in zip("xyz", park or (), strict=False):
        span = getattr(printer, f"{axis}_mm")
        if not span.low <= mm <= span.high:
            raise Refused(
                f"park_mm: {axis.upper()} {mm:g} mm is outside {span.low:g} to {span.high:g} mm "
                f"({axis}_mm of {printer.name}); specify a position within"
            )


def _park_place(run: Print, park: Park | None) -> Park | None:
    """Return ``park`` as the job counts here; None, with an alarm, where that is no safe place."""
    if park is None:
        return None
    at, problem = run.progress.modal(), ""
    try:
        x, y, z = run.shift_mm()
        if park[2] < run.reach.top_mm and run.reach.is_inside(*park):
            problem = f"{park} mm is within the printed area; specify a position beside it"
        elif None in (at.x, at.y, at.z):
            problem = "the job doesn't contain the needle's position"
    except LinkError as exc:
        problem = str(exc)
    if problem:
        run.logbook.alarm(f"the needle isn't moved to park_mm but waits straight above: {problem}")
        return None
    return park[0] + x, park[1] + y, park[2] + z


def lead_needle(run: Print, at: Modal, park: Park, *, back: bool) -> Steps[None]:
    """Lead the needle between above ``at`` and ``park``; each step is waited for.

    Up first, then across above all that the job writes, within the axis, then to the park's height.
    """
    speed, shift, z = run.printer.max_speed_mm_s, run.shift_mm()[2], at.z or 0.0
    up, across = min(run.retreat.lift_mm_s, speed.z), min(ACROSS_MM_S, speed.x, speed.y)
    wanted = max(z + run.retreat.lift_mm, run.reach.top_mm + shift + ABOVE_MM, park[2])
    high = max(z, min(wanted, run.printer.z_mm.high + shift))
    x, y = (at.x or 0.0, at.y or 0.0) if back else park[:2]
    way = [(b"Z%.5f" % high, up), (b"X%.5f Y%.5f" % (x, y), across), (b"Z%.5f" % park[2], up)]
    for place, mm_s in way[:2] if back else way:
        yield from run.channel.command(b"G1 %b F%.0f" % (place, mm_s * 60))
        yield from run.channel.command(b"M400")


def is_parked(run: Print, at: Modal, park: Park) -> Steps[bool]:
    """Whether the printer says that it stands at the parking place, and not above ``at``."""
    if at.x is None or at.y is None or at.z is None:
        return False
    wrong, _ = yield from run.position.compare(Modal(x=park[0], y=park[1]))
    return (at.x, at.y) != park[:2] and not wrong
