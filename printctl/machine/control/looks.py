"""Hold a print for inspection until a client or the operator decides.

A look is held as a pause is: nothing in flight, motors at rest, place compared, valve shut or
plunger relieved, needle out of the bath. It ends by a word: go on, pause, stop. Where none comes
within ``look_limit_s`` it becomes a pause for the operator, with an alarm.
"""

from __future__ import annotations

from dataclasses import dataclass

from printctl.machine.control.channel import Channel
from printctl.machine.control.inserting import Inserting
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.look_book import Look, LookDecision, decided_answer
from printctl.machine.control.parking import Park, Parking
from printctl.machine.control.pauses import PAUSE_SIGN_S, Pauses
from printctl.machine.control.requests import Request, ResumeRequest
from printctl.machine.control.watch import DueTask
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.journalled_print import JournalledPrint
from printctl.machine.records.states import LinkState

OBSERVER = "the observer"


@dataclass(frozen=True)
class _Ending:
    """How a look ends: decision, reason, whose; whether a syringe is changed, or it failed."""

    decision: LookDecision
    why: str
    by: str
    changing: bool = False
    again: bool = False


@dataclass(frozen=True)
class Looks:
    """Does what is due at a mark, looks first.

    Attributes
    ----------
    channel : Channel
    pauses : Pauses
    inserting : Inserting
    parking : Parking
    """

    channel: Channel
    pauses: Pauses
    inserting: Inserting
    parking: Parking

    def restore(self, history: JournalledPrint, done: int) -> None:
        """Take up what a process that died has written down of looks; ``done`` lines are taken."""
        watch = self.pauses.watch
        self.inserting.book.restore(history.looked, history.inserts)
        if history.looked:
            now = self.channel.wiring.clock.now()
            watch.looked(now, int(history.looked[-1]["done"]))
        for one in history.inserts:
            end = one.after + len(one.lines)
            looked = any(int(each["done"]) == end for each in history.looked)
            if one.again and done <= end and not looked:
                watch.look_behind(end)
        undecided = history.look is not None and int(history.look["done"]) == done
        if undecided or _still_paused(history, done):
            watch.look_again()

    def at_mark(self) -> None:
        """Do what is due after the lines that were taken; nothing is in flight."""
        progress, watch = self.channel.logbook.progress, self.pauses.watch
        while watch.due(self.channel.wiring.clock.now(), progress.done) is DueTask.LOOK:
            self.look()
        if progress.done < len(progress.job):
            self.pauses.at_mark()

    def look(self) -> None:
        """Leave the bath, wait for a decision, and do as it says.

        Raises
        ------
        StopRequested
        """
        logbook, pauses, book = self.channel.logbook, self.pauses, self.inserting.book
        clock, care, done = self.channel.wiring.clock, pauses.watch.care, logbook.progress.done
        look = book.begin(done, *self._place(done), care.look_limit_s)
        logbook.record("look", look=look.number, done=done, mark=look.mark, layer=look.layer)
        park = self.parking.place(care.look_park_mm)
        at = pauses.leave("look", park=park)
        pauses.watch.checked(clock.now(), done)
        if park is not None:
            self.parking.go(at, park)
        logbook.enter(LinkState.LOOKING, f"held for {_name(look)}: waiting for a decision")
        pauses.excursion.rest()
        ending = self._ended(at, clock.now() + look.limit_s)
        self._decide(look, ending)
        if ending.decision is LookDecision.STOP:
            pauses.queue.add(Request.STOP, by=ending.by)
            raise StopRequested
        changes = pauses.change.begun
        self._leave_look(at, park, look, ending)
        changed = pauses.change.begun > changes and not book.has_insert(look.number)
        if (changed or self._is_made_again(look, ending)) and not pauses.watch.unobserved:
            pauses.watch.look_again()

    def _is_made_again(self, look: Look, ending: _Ending) -> bool:
        """Whether a look that failed is made once more; one that failed twice isn't."""
        return ending.again and not self.inserting.book.failed_before(look)

    def _leave_look(self, at: Modal, park: Park | None, look: Look, ending: _Ending) -> None:
        """Come back above the job's place; go on, or stay for the operator."""
        pauses = self.pauses
        goes_on = ending.decision is LookDecision.GO_ON
        words = "returning to where the print was left" if goes_on else self._paused(look, ending)
        if goes_on or park is not None:
            state = LinkState.RESUMING if goes_on else LinkState.PAUSING
            self.channel.logbook.enter(state, words)
            pauses.excursion.come_back(pauses.position.height())
        if park is not None:
            pauses.meddling.own_modes()
            self.parking.come(at, park)
        if goes_on:
            pauses.come_back(at, by_person=ending.by != OBSERVER)
            return
        if ending.changing:
            pauses.change.plan(pauses.requests.reload_head)
            pauses.begin_change(at)
            words = pauses.change.words()
        pauses.wait_and_come_back(at, words)

    def _paused(self, look: Look, ending: _Ending) -> str:
        """What the operator is told of a pause that came of a look."""
        then = "goes on as it is" if ending.by == OBSERVER else "goes on"
        if self._is_made_again(look, ending):
            then = "makes this look again (with --unobserved it goes on without)"
        elif ending.again:
            then = "goes on without this look"
        return f"paused at {_name(look)}: {ending.why}; `printctl resume RUN` {then}"

    def _place(self, done: int) -> tuple[str, int]:
        """What ended there, in words, and the layer that ended last."""
        marks = self.channel.logbook.progress.job.marks
        usual = "end of a line within a layer"
        if self.pauses.watch.is_behind_insert(done):
            usual = "end of what was inserted"
        here = ", ".join(str(mark) for mark in marks.here(done)) or usual
        layer = marks.last(MarkKind.LAYER, done)
        return here, -1 if layer is None else layer.number

    def _ended(self, at: Modal, until_s: float) -> _Ending:
        """Wait for what ends a look; answer what is said meanwhile.

        Raises
        ------
        StopRequested
        """
        channel, pauses = self.channel, self.pauses
        clock, queue = channel.wiring.clock, pauses.queue
        while True:
            until = min(clock.now() + PAUSE_SIGN_S, until_s)
            while clock.now() < until and not queue.waiting:
                channel.pump(until)
                pauses.ending.end_on_fault()
            pauses.commands.send_all(channel.wiring.printing_limits)
            pauses.ending.end_on_fault()
            ending = self._said(at) or _asked(queue.take())
            if ending is not None:
                return ending
            if clock.now() >= until_s:
                return self._nobody_decided()
            pauses.motors.sign_of_life()

    def _said(self, at: Modal) -> _Ending | None:
        """Answer clients; return their decision, written down by whoever ends the look."""
        word = self.inserting.answer_all(at)
        if word is None or word.decision is None:
            return None
        failed = word.again and word.decision is LookDecision.PAUSE
        ending = _Ending(word.decision, word.why, OBSERVER, again=failed)
        look = self.inserting.book.current
        if look is not None:
            self._decide(look, ending)
            word.done(decided_answer(self._record(look, ending)))
        return ending

    def _nobody_decided(self) -> _Ending:
        limit = self.pauses.watch.care.look_limit_s
        why = f"nobody decided within {limit:g} s (look_limit_s): the observer hangs or is gone"
        return _Ending(LookDecision.PAUSE, why, "the link", again=True)

    def _decide(self, look: Look, ending: _Ending) -> None:
        """Write a decision down, once; an alarm where a person must know of it."""
        book, logbook = self.inserting.book, self.channel.logbook
        if book.decided(look.number):
            return
        record = self._record(look, ending)
        logbook.record("looked", **record)
        book.decide(record)
        self.pauses.watch.looked(self.channel.wiring.clock.now(), look.done)
        if ending.decision is not LookDecision.GO_ON and ending.by != "the user":
            logbook.alarm(f"{_name(look)}: {ending.by} decided to {ending.decision}: {ending.why}")

    def _record(self, look: Look, ending: _Ending) -> dict[str, object]:
        told = {"decision": str(ending.decision), "why": ending.why, "by": ending.by}
        failed = {"again": True} if ending.again else {}
        return {"look": look.number, "done": look.done, **told, **failed}


def _still_paused(history: JournalledPrint, done: int) -> bool:
    """Whether it died in a pause that came of a look here: what that waited for is asked again."""
    if not history.looked or history.state not in (LinkState.PAUSING, LinkState.PAUSED):
        return False
    last = history.looked[-1]
    return last["decision"] == LookDecision.PAUSE and int(last["done"]) == done


def _asked(request: Request | ResumeRequest | None) -> _Ending | None:
    """What somebody's request makes of a look; None for nothing.

    Raises
    ------
    StopRequested
    """
    if request is Request.STOP:
        raise StopRequested
    if request is Request.PAUSE:
        return _Ending(LookDecision.PAUSE, "a pause was asked for", "the user", again=True)
    if request is Request.RELOAD:
        why = "a change of syringe was asked for"
        return _Ending(LookDecision.PAUSE, why, "the user", again=True, changing=True)
    if isinstance(request, ResumeRequest):
        request.answer("")
        return _Ending(LookDecision.GO_ON, "the operator's word (resume)", "the user")
    return None


def _name(look: Look) -> str:
    return f"look {look.number} at the {look.mark}"
