"""Hold a print at marks, on request or by dead-man's time: leave, wait, come back."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from firmware_profiles.families import family_of
from firmware_profiles.families.position_reply import parse_position
from printctl.checks.gate import LineOrigin, PrinterSituation, Refusal, judge
from printctl.machine.control.board.steps import Record, Steps
from printctl.machine.control.excursion import CHANGE, Excursion
from printctl.machine.control.gating import paused_situation
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.look_book import LookRequest
from printctl.machine.control.position.place import MOVED, WITHIN_MM
from printctl.machine.control.printing.context import Print
from printctl.machine.control.printing.ending import end_on_fault, retreat
from printctl.machine.control.printing.factors import notice_changes, pause_on_changes
from printctl.machine.control.printing.inserting import answer_clients, refuse_rest
from printctl.machine.control.printing.others import own_modes, take_back
from printctl.machine.control.printing.syringes import (
    begin_change,
    count_plunger,
    replan,
    take_head,
)
from printctl.machine.control.requests import PauseUntil, Request, ResumeRequest
from printctl.machine.control.watch import DueTask
from printctl.machine.errors import LinkError
from printctl.machine.families import link_facts
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.coordinates import Modal, last_of
from printctl.machine.job.dispensing import reopen, shut_and_wait
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import count_from
from printctl.machine.records.states import LinkState

PAUSE_SIGN_S: Final = 20.0
"""Interval of the sign of life in a pause."""
AGAIN_S: Final = 5.0
"""The same in a pause that ends by itself, where it is looked whether it does."""
QUIET_QUESTIONS: Final = 20
"""Questions by which a line is tried that garbled too many."""


_BY_ITSELF: Final = ResumeRequest()


def pause_where_due(run: Print) -> Steps[None]:
    """Do what is due after the lines that were taken, but for looks; nothing is in flight."""
    watch, done, change = run.watch, run.progress.done, run.change
    due = watch.due(run.channel.now, done)
    where = ", ".join(str(mark) for mark in run.job.marks.here(done)) or f"line {done}"
    if due is DueTask.RELOAD:
        planned = done in watch.reload_at
        change.planned_head = watch.reload_head(done) if planned else change.wanted_head
        yield from pause(run, f"paused at the {where}: {change.words(run.printer)}", changing=True)
    elif due is DueTask.PAUSE:
        yield from pause(run, f"paused at the {where}")
    elif due is DueTask.DEADMAN:
        message = f"no operator confirmed presence for {watch.care.deadman_s / 60:g} min (dead-man)"
        run.logbook.alarm(message)
        if watch.care.deadman_stops:
            yield from retreat(run, LinkState.STOPPED, message)
        yield from pause(run, f"{message}; `printctl resume RUN` continues")
    elif due is DueTask.CHECKPOINT:
        # stand still for it where nothing else can tell what was made
        stands = link_facts(run.printer).plans_by_time
        if stands:
            yield from run.channel.command(b"M400")
        yield from run.position.verify(run.progress.modal(), mark=where, stands=stands)
        yield from pause_on_changes(run)
        watch.checked(run.channel.now, done)


def want_pause(run: Print, after: MarkKind | None) -> None:
    """Have the print held at the next mark of a kind, None for no longer; write it down."""
    run.wiring.exchange.effects.append(wanted_pause(run, after))


def wanted_pause(run: Print, after: MarkKind | None) -> Record:
    """Have the print held at the next mark of a kind; return the record of it, by any thread."""
    run.watch.after = after
    head = {} if after is not MarkKind.RELOAD else {"head": run.change.wanted_head}
    return Record("wanted", {"after": after or "", **head})


def hold_for_room(run: Print) -> None:
    """Have the print paused while the journal can't be written; it goes on by itself then."""
    fault = run.wiring.exchange.journal_fault
    run.logbook.alarm(f"{fault}; pausing", kind="no room")
    why = f"{fault}; the print resumes by itself once the journal can be written again"
    run.queue.add(Request.PAUSE, why=why, until=PauseUntil.ROOM)


def pause(run: Print, message: str, changing: bool = False) -> Steps[None]:
    """Leave the bath, wait for the word to go on, and come back."""
    run.watch.paused(run.progress.done)
    at = yield from leave(run, "pause", changing)
    yield from wait_and_come_back(run, at, message)


def leave(
    run: Print,
    mark: str,
    changing: bool = False,
    park: tuple[float, float, float] | None = None,
) -> Steps[Modal]:
    """Let the planner run empty, compare the place, relieve the plunger, lift the needle.

    Returns the job's place. ``mark``: what the print is held for, for the journal; ``park``, mm:
    where the needle will be led from above the place.
    """
    logbook, channel = run.logbook, run.channel
    logbook.enter(
        LinkState.PAUSING,
        "the printer's queued moves are executed; then the plunger is relieved and the needle "
        "lifted",
    )
    yield from channel.command(b"M400")
    yield from shut_valve(run)  # what was taken is written; nothing more
    at = yield from run.position.expected()
    yield from run.position.verify(at, mark=mark, stands=True)
    yield from notice_changes(run)  # before the plunger is relieved: by a factor it is otherwise
    logbook.record("left", place=at.place(), **({} if park is None else {"park": park}))
    yield from own_modes(run)
    channel.led = {axis.upper(): [mm] for axis, mm in at.place().items()}
    relieved = run.progress.relieved_mm
    run.excursion = Excursion(True, at, relieved, _top(run, at, changing))
    yield from channel.commands(run.retreat.leave(at, run.printer, relieved))
    if changing:
        yield from begin_change(run, at)
    yield from channel.command(b"M400")
    return at


def compare_away(run: Print) -> Steps[None]:
    """End the print where the needle isn't where it was led to from the job's place.

    A stop compares by itself, and the job's lines wait for a comparison of theirs.
    """
    if run.excursion.going_on and run.logbook.state is not LinkState.STOPPING:
        yield from run.position.refuse_led_astray(run.excursion.counted)


def _top(run: Print, at: Modal, changing: bool) -> float | None:
    """Return the greatest height of the way out of ``at``, mm."""
    if at.z is None:
        return None
    lift = max(run.retreat.lift_mm, run.wiring.retreat.park_mm if changing else 0.0)
    return max(at.z, min(at.z + lift, run.printer.z_mm.high))


def wait_and_come_back(run: Print, at: Modal, message: str) -> Steps[None]:
    """Wait for the word to go on; then count a new syringe, and come back to ``at``."""
    astray = (yield from run.position.standing_away(run.excursion.counted)).wrong
    if astray:
        astray = f"the position doesn't match the job any more ({astray}: {MOVED})"
        run.logbook.alarm(astray)
        message = f"{astray}; {message}"
    run.logbook.enter(LinkState.PAUSED, message)
    run.excursion.rests = True
    resume = yield from _stay_paused(run, at)
    run.logbook.enter(LinkState.RESUMING, "returning to the print position")
    run.channel.tell(resume.answer, "")
    new = resume.change if run.change.going_on else None
    if new or (run.change.going_on and run.change.idle_head is not None):
        yield from count_plunger(run, at, new or NewSyringe())
    yield from come_back(run, at, run.retreat.prime_mm, by_person=resume is not _BY_ITSELF)


def come_back(run: Print, at: Modal, prime_mm: float = 0.0, by_person: bool = False) -> Steps[None]:
    """Take back what others have set, lower the needle to ``at``, and go on printing.

    ``by_person``: it was a person's word, so that somebody is there (dead-man's time).
    """
    yield from run.position.refuse_pushed(run.excursion.plunger_e(run.retreat))
    yield from take_back(run)
    yield from own_modes(run)
    yield from run.position.refuse_renamed(waited=True)  # before the needle is lowered by that name
    yield from run.position.refuse_elsewhere(at.x, at.y, at.z)
    yield from take_head(run)
    yield from notice_changes(run)
    yield from lower(run, at, prime_mm)
    run.change.going_on, run.change.planned_head = False, None
    yield from run.position.frame.note_plunger()
    run.book.current = None
    refuse_rest(run)
    run.queue.pause_until = None
    if by_person:
        run.watch.confirmed = run.channel.now
    run.begin_pace()
    run.logbook.enter(LinkState.PRINTING, "printing")
    yield from reopen_valve(run)


def lower(run: Print, at: Modal, prime_mm: float = 0.0) -> Steps[None]:
    """Lower the needle to ``at``, push the plunger to its place, and compare both.

    Each step of the way down is waited for, so that a stop finds no further one ahead.
    """
    channel, height = run.channel, (yield from run.position.height())
    yield from _adopt_plunger(run, at, height)
    run.excursion.come_back(height)
    for move in run.retreat.lower(at, run.printer, height):
        yield from channel.command(move)
        yield from channel.command(b"M400")
    yield from channel.commands(run.retreat.rejoin(replace(at, z=None), run.printer, prime_mm))
    yield from channel.command(b"M400")
    yield from run.position.verify(at)
    run.excursion.going_on = False


def _adopt_plunger(run: Print, at: Modal, height_mm: float) -> Steps[None]:
    """Count a plunger that was moved by hand meanwhile as the link had left it.

    Nothing is drawn back, or pushed on, in the print to undo it. Of a print found again after its
    host's death it isn't known whether the plunger had been relieved yet.
    """
    e = None
    if at.e is not None and not run.printer.pneumatic:
        e = yield from run.position.plunger()
    if at.e is None or e is None:
        return
    relieved = run.retreat.relieved_e(at.e, run.excursion.relieved_mm)
    highest = at.e if run.excursion.top is None else relieved
    if relieved - WITHIN_MM <= e <= highest + WITHIN_MM:
        return
    lifted = at.z is None or height_mm > at.z + WITHIN_MM
    left = relieved if lifted or e < relieved else at.e
    run.logbook.alarm(
        f"the plunger is at E {e:.2f} mm but was left at {left:.2f} mm: it was moved by "
        f"{e - left:+.2f} mm during the pause; its new position is accepted, so that the print "
        "neither retracts nor dispenses to undo that"
    )
    yield from run.channel.command(count_from(left))


def _stay_paused(run: Print, at: Modal) -> Steps[ResumeRequest]:
    """Wait for a request to go on that can be granted, and return it; refuse the others."""
    change = run.change
    while True:
        word = yield from await_word(run, at)
        if isinstance(word, LookRequest):  # of a look that became a pause without any decision
            run.channel.tell(word.refused, "the print is paused; `printctl resume RUN` continues")
        elif word is Request.RELOAD and not change.going_on:
            change.planned_head = change.wanted_head
            yield from begin_change(run, at)
            run.logbook.enter(LinkState.PAUSED, change.words(run.printer))
        elif isinstance(word, ResumeRequest):
            problem = yield from _why_not_resume(run, at, word)
            if not problem:
                return word
            run.logbook.alarm(problem)
            run.logbook.enter(LinkState.PAUSED, problem)
            run.channel.tell(word.answer, problem)
        yield from sign_of_life(run)


def _why_not_resume(run: Print, at: Modal, request: ResumeRequest) -> Steps[str]:
    """Return what keeps the needle from coming down; empty for nothing."""
    if fault := run.wiring.exchange.journal_fault:
        return f"not resumed: {fault}"
    if run.change.going_on and not (request.change or request.unchanged):
        return f"not resumed: {CHANGE}"
    wrong, _ = yield from run.position.compare(Modal(x=at.x, y=at.y))
    if wrong:
        return f"not resumed: {wrong}; move the needle back above that position first"
    if run.change.going_on and request.change:
        try:
            replan(run, request.change)
        except LinkError as exc:
            return f"not resumed: {exc}"
    return ""


def await_word(
    run: Print, at: Modal, until: float = math.inf
) -> Steps[LookRequest | ResumeRequest | Request | None]:
    """Wait for a decision or a request while held at ``at``; None at ``until``, s.

    Inserts are taken meanwhile, manual commands sent; a stop raises `StopRequested`.
    """
    channel, queue = run.channel, run.queue
    while True:
        limit = min(channel.now + (AGAIN_S if run.queue.pause_until else PAUSE_SIGN_S), until)
        while channel.now < limit and not queue.waiting:
            yield from channel.pump(limit)
            yield from end_on_fault(run)
        yield from send_manual(run)
        yield from end_on_fault(run)
        word = (yield from answer_clients(run, at)) or queue.take()
        if word is Request.STOP:
            raise StopRequested
        if word is not None or channel.now >= until:
            return word
        if run.queue.pause_until and (yield from _is_over(run)):
            run.logbook.notice("the cause of the pause is gone: the print resumes")
            return _BY_ITSELF
        yield from sign_of_life(run)


def _is_over(run: Print) -> Steps[bool]:
    """Whether the cause of a pause that ends by itself is over."""
    if run.queue.pause_until is PauseUntil.ROOM or run.wiring.exchange.journal_fault:
        return not run.wiring.exchange.journal_fault
    care, protocol = run.watch.care, run.wiring.protocol
    before = protocol.line_errors
    for _ in range(QUIET_QUESTIONS):
        yield from run.channel.command(b"M105")
    share = care.noise_limit / care.noise_window
    return protocol.line_errors - before <= share * QUIET_QUESTIONS


def sign_of_life(run: Print) -> Steps[None]:
    """Show that the printer is there, and begin its own switch-off time anew.

    Only moves and the command that sets that time begin it anew; M105 doesn't.
    """
    code = family_of(run.printer).timeout_code
    codes = (code.encode("ascii"),) if code else ()
    yield from run.channel.command(last_of(run.job.lines, run.progress.done, codes) or b"M105")


def send_manual(run: Print) -> Steps[None]:
    """Send the waiting manual commands that the gate lets pass; a complaint ends no print."""
    while run.queue.commands:
        manual = run.queue.commands.popleft()
        if manual.refused is None:
            lines = yield from run.channel.command(manual.text.encode("ascii"))
            run.channel.tell(manual.done, lines)
            continue
        verdict = judge(manual.text, LineOrigin.CONSOLE, (yield from _situation(run)))
        if isinstance(verdict, Refusal):
            run.logbook.notice(verdict.message)
            run.channel.tell(manual.refused, verdict.message)
            continue
        before = run.logbook.fault
        try:
            lines = yield from run.channel.command(verdict.text.encode("ascii"))
        except StopRequested:
            run.channel.tell(manual.refused, "the print is being cancelled")
            raise
        complaint = run.logbook.excuse(before)
        if not complaint:
            run.heat.set_by_hand(verdict)
        lines = (*lines, complaint.encode("ascii", "replace")) if complaint else lines
        run.channel.tell(manual.done, lines)


def _situation(run: Print) -> Steps[PrinterSituation]:
    """Return what the gate judges by; in a pause the printer is asked where it stands."""
    if run.logbook.state is not LinkState.PAUSED:
        return run.wiring.printing_limits()
    at, excursion = parse_position((yield from run.channel.command(b"M114"))), run.excursion
    if excursion.clear_mm is None and {"X", "Y", "Z"} <= set(at):
        excursion.clear_mm = at["Z"]
    return paused_situation(run.wiring.limits(), at, excursion.clear_mm)


def shut_valve(run: Print) -> Steps[None]:
    """Shut a pneumatic head's valve: before the needle is lifted, and before questions."""
    for command in shut_and_wait(run.printer):
        yield from run.channel.command(command)
        run.valve_shut = True


def reopen_valve(run: Print) -> Steps[None]:
    """Open it again where the link had shut it within a path, with the tip back in place."""
    if run.valve_shut:
        yield from run.channel.commands(reopen(run.job.lines, run.progress.done, run.printer))
    run.valve_shut = False
