"""Handle each inspection hold of a print: acquire a picture, judge, decide, act, record.

The observer is a client of the link process. It may die at any moment: the link holds the needle
out of the bath until a look is decided, and pauses the print for the operator without a decision.
What has been decided is in the link's journal, so a look is never acted on twice; what the flow
control knew is in the record of each look, so a new observer goes on from there.
"""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Protocol

from pydantic import TypeAdapter

from printctl.inspection.values import Gap
from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import LinkError, Refused
from printctl.machine.records.actor import ACTOR
from printctl.observe.deciding import Decider, Decision, DecisionKind
from printctl.observe.deciding.evidence import ThinStretch
from printctl.observe.devices import DeviceError, find_picture
from printctl.observe.looks.look_context import Look, LookJudgement, MendLines
from printctl.observe.records import (
    POSTPONED_KEY,
    STATE_KEY,
    Answer,
    LookRecord,
    amend_look,
    clear_look_folder,
    look_folder,
    read_answer,
    read_looks,
    save_look,
    who_answered,
)

log = logging.getLogger(__name__)
_ANSWER_POLL_S: Final = 0.2
_MIN_SEEN_SHARE: Final = 0.1
"""Share of the lines; in a picture taken too early some may seem to lie over bath."""
_MAX_MISSING_SHARE: Final = 0.5
"""Of a line's ink, which is missing along `_MIN_CLOG_MM`: a partial clog, which is reported."""
_MIN_CLOG_MM: Final = 2.0


def state_of(decider: Decider) -> dict[str, Any]:
    """Return a decider's state, ready for JSON, as each look's record keeps it."""
    state: dict[str, Any] = json.loads(json.dumps(asdict(decider)))
    del state["limits"], state["control"]["limits"]  # the order's
    return state


def restore(decider: Decider, state: dict[str, Any]) -> None:
    """Set a decider to a saved state, except its limits; ignore an older release's state."""
    if "last_shift_mm" not in state or "control" not in state:
        return
    known = TypeAdapter(Decider).validate_python(state)
    known.control.limits = decider.control.limits
    for one in fields(Decider):
        if one.name != "limits":
            setattr(decider, one.name, getattr(known, one.name))


class PrintLink(Protocol):
    """Commands of a print's link that the observer uses (`PrintClient`)."""

    def insert(
        self, look: int, lines: Sequence[str], why: str, flow: float | None, again: bool
    ) -> object:
        """Put lines into the job where it is held, and correct the flow of its rest.

        With ``again`` another look is made once they are written.
        """

    def decide(self, look: int, decision: LookDecision, why: str, again: bool = False) -> object:
        """End a look; with ``again`` it failed, and is made again when the print goes on."""

    def resume(self) -> None:
        """Go on after a pause."""

    def stop(self) -> None:
        """Stop the print."""


@dataclass
class Observer:
    """Observer of one print.

    Attributes
    ----------
    folder : Path
        The print's.
    link : PrintLink
    acquire : callable
        Takes a look's picture into a path without suffix; gives the file.
    judge : callable
        Judges one or two pictures of a look; the second may be None.
    mend_lines : callable
        Plans what mends gaps and fills thin lines up, at a flow over the file's.
    decider : Decider
    ended : callable
        Whether the print is over, or has left the look of this number.
    begun : float, s since 1970
        Of the print: earlier records in the folder are another print's.
    clock : callable
        Seconds since 1970.
    """

    folder: Path
    link: PrintLink
    acquire: Callable[[Look, Path], Path]
    judge: Callable[[Look, Path, Path | None], LookJudgement]
    mend_lines: Callable[[Look, tuple[Gap, ...], tuple[ThinStretch, ...], float, bool], MendLines]
    decider: Decider
    ended: Callable[[int], bool]
    begun: float = 0.0
    clock: Callable[[], float] = time.time

    def __post_init__(self) -> None:
        self._new = state_of(self.decider)

    @property
    def looks(self) -> list[LookRecord]:
        """Records of this print's looks."""
        return read_looks(self.folder, self.begun)

    def find_record(self, number: int) -> LookRecord | None:
        """Return a look's record; None where there is none."""
        return next((one for one in self.looks if one.number == number), None)

    def restore_state(self, number: int) -> None:
        """Set the decider to its state before a look, as the earlier looks' records have it."""
        looks = [one for one in self.looks if one.number < number]
        restore(self.decider, looks[-1].control if looks else self._new)

    def look(self, look: Look) -> LookRecord:
        """Inspect: acquire, judge, decide and act; device failures become a pause.

        Raises
        ------
        LinkError
            When the link can't be reached.
        OSError
            When the record can't be written: the look then stays undecided, and the link pauses.
        """
        place, begun = clear_look_folder(self.folder, look.number), self.clock()
        try:
            judged = self._judge_pictures(look, place)
        except DeviceError as exc:
            record = self._record(look, DecisionKind.PAUSE, f"nothing seen: {exc}", {}, begun)
            save_look(self.folder, record)
            self._end(look, "pause", record.why, again=True)
            return record
        if self._has_ended(look.number):  # its pictures may show what was written since
            record = self._record(look, DecisionKind.GO_ON, _NOT_JUDGED_REASON, {}, begun)
            save_look(self.folder, record)
            return record
        decision = self._decide(judged)
        found = _with_left_mm(judged.found, math.fsum(gap.length_mm for gap in decision.gaps))
        record = self._record(look, decision.kind, decision.why, found, begun)
        if judged.learned:
            record.control[STATE_KEY] = judged.learned
        asked = decision.ask.value if decision.ask else ""
        record = replace(record, asked=asked, factor=decision.factor)
        save_look(self.folder, record)
        self._act(look, decision)
        return self.find_record(look.number) or record

    def _has_ended(self, number: int) -> bool:
        """Return whether the look was ended elsewhere; False if the link doesn't answer."""
        try:
            return self.ended(number)
        except LinkError:
            return False

    def note_failure(self, look: Look, why: str) -> None:
        """Record a failed look: its ink wasn't inspected.

        Raises
        ------
        OSError
            When it can't be written.
        """
        kept = self.find_record(look.number)
        if kept is not None:
            amend_look(self.folder, replace(kept, why=f"{kept.why}; {why}", asked=""))
            return
        self.restore_state(look.number)
        save_look(self.folder, self._record(look, DecisionKind.PAUSE, why, {}, self.clock()))

    def _decide(self, judged: LookJudgement) -> Decision:
        self.decider.control.put_in_force(judged.flow)
        if POSTPONED_KEY in judged.found:
            share = judged.evidence.seen_share
            why = f"{share:.0%} was seen of a part of a vessel: the next look judges it, too"
            return Decision(DecisionKind.GO_ON, why)
        decision = self.decider.decide(judged.evidence)
        unseen = judged.found.get("not_seen")
        return replace(decision, why=f"{decision.why} ({unseen})") if unseen else decision

    def _judge_pictures(self, look: Look, place: Path) -> LookJudgement:
        """Judge one picture; confirm gaps, thin lines and unseen vessels by a second one.

        A picture in which hardly anything is seen is taken anew: a device that takes them by itself
        may have begun with it before the needle was held, and one that hangs gives the same again.
        Where no other comes (a program that takes one at each look), the first alone counts.
        """
        picture = self.acquire(look, place / "picture")
        judged, limits = self.judge(look, picture, None), self.decider.limits
        if judged.evidence.seen_share < _MIN_SEEN_SHARE and not look.within_vessel:
            try:
                picture = self.acquire(look, place / "picture")
            except DeviceError as exc:
                return _by_single_picture(judged, exc)
            judged = self.judge(look, picture, None)
        evidence = judged.evidence
        gaps = any(limits.gap.significant(gap, evidence.places) for gap in evidence.gaps)
        if look.within_vessel and not gaps and evidence.seen_share < limits.least_seen:
            return replace(judged, found={**judged.found, POSTPONED_KEY: True})
        if not (gaps or evidence.thin or evidence.unseen):
            return judged
        try:
            again = self.acquire(look, place / "again")
        except DeviceError as exc:
            return _by_single_picture(judged, exc)
        return self.judge(look, picture, again)

    def _record(
        self, look: Look, kind: DecisionKind, why: str, found: dict[str, Any], begun: float
    ) -> LookRecord:
        return LookRecord(
            number=look.number,
            done=look.done,
            job_line=look.job_line,
            mark=look.mark,
            at=max(begun, self.begun),  # a clock that was set back meanwhile
            decision=kind.value,
            why=why,
            found=found,
            control=state_of(self.decider),
            seconds={"all": round(self.clock() - begun, 3)},
        )

    # --- acting ----------------------------------------------------------------------------------

    def _end(self, look: Look, decision: str, why: str, again: bool = False) -> None:
        self.link.decide(look.number, LookDecision(decision), why, again)

    def _act(self, look: Look, decision: Decision) -> None:
        kind = decision.kind
        if decision.ask is not None:
            self._ask(look, decision, decision.why)
        elif kind in (DecisionKind.MEND, DecisionKind.FLOW):
            self._mend_or_ask(look, decision)
        elif kind is DecisionKind.PAUSE and decision.factor is not None:
            self._end(look, kind, f"{decision.why}{self._insert_mend(look, decision).left}")
        else:
            self._end(look, kind, decision.why)

    def _ask(self, look: Look, decision: Decision, why: str) -> None:
        """Pause and wait for the operator's answer; the needle stays out of the bath."""
        self._end(look, "pause", why)
        self._follow_answer(look, decision)

    def ask_again(self, look: Look) -> None:
        """Judge the pictures of a dead observer's look again and wait for its answer."""
        place = look_folder(self.folder, look.number)
        picture = find_picture(place, "picture")
        if picture is None:
            raise DeviceError(f"the look's picture isn't in {place} any more")
        judged = self.judge(look, picture, find_picture(place, "again"))
        self._follow_answer(look, self._decide(judged))

    def _follow_answer(self, look: Look, decision: Decision) -> None:
        answer = self._await_answer(look.number)
        before = ACTOR.set(who_answered(self.folder, look.number))
        try:
            self._do_as_answered(look, decision, answer)
        finally:
            ACTOR.reset(before)

    def _do_as_answered(self, look: Look, decision: Decision, answer: Answer | None) -> None:
        if answer == "approve":
            put = self._insert_mend(look, decision, approved=True)
            if put.done:
                self._amend(look, f"{decision.why}{put.left}", put.left_mm)
                self.go_on(look.number)
            else:
                then = (
                    "it can't be mended from here: resume continues without, cancel ends the print"
                )
                self._amend(look, f"{decision.why}{put.left}; approved, but {then}", asked="")
        elif answer == "go_on":
            self.go_on(look.number)
        elif answer == "stop":
            self.link.stop()

    def go_on(self, number: int) -> None:
        """Resume as answered; note in the record if the link waits for something else first."""
        try:
            self.link.resume()
        except Refused as exc:
            record, reason = self.find_record(number), f"; not gone on yet: {exc}"
            log.warning("look %d%s", number, reason)
            if record is not None and reason not in record.why:
                amend_look(self.folder, replace(record, why=record.why + reason))

    def _amend(self, look: Look, why: str, left_mm: float | None = None, **changes: Any) -> None:
        """Amend a look's record by the outcome of its decision and the length left."""
        record = self.find_record(look.number)
        if record is not None:
            found = record.found if left_mm is None else _with_left_mm(record.found, left_mm)
            amend_look(self.folder, replace(record, why=why, found=found, **changes))

    def _await_answer(self, number: int) -> Answer | None:
        """Wait for the operator's answer; return None if the print left the look without one."""
        while (answer := read_answer(self.folder, number)) is None:
            if self.ended(number):
                return None
            time.sleep(_ANSWER_POLL_S)
        return answer

    def _mend_or_ask(self, look: Look, decision: Decision) -> None:
        put = self._insert_mend(look, decision)
        why = f"{decision.why}{put.left}"
        if put.done:
            self._amend(look, why, put.left_mm)
            self._end(look, "go_on", why)
        elif put.given_up:  # nothing is mended: all stays left
            self._amend(look, why, decision="pause", asked=DecisionKind.MEND.value)
            self._ask(look, decision, why)
        else:
            why = f"{why}; it can't be mended from here"
            self._amend(look, why, decision="pause")
            self._end(look, "pause", why)

    def _insert_mend(self, look: Look, decision: Decision, approved: bool = False) -> _Insertion:
        """Insert mend and flow into the job; return the outcome and what stays unmended.

        What was written in vain before is written again where the operator has approved it alone.
        """
        flow = decision.factor or self.decider.control.factor
        gaps, thin = decision.gaps, decision.thin
        mend = MendLines()
        if gaps or thin:
            mend = self.mend_lines(look, gaps, thin, flow, approved)
        left = f"; not mended: {mend.left}" if mend.left else ""
        if mend.given_up:
            return _Insertion(False, left, given_up=True)
        if not mend.lines and decision.factor is None:
            # The operator is to know where much lacks most of its ink; other thin lines stay.
            clog_mm = math.fsum(one.length_mm for one in thin if one.missing > _MAX_MISSING_SHARE)
            return _Insertion(not gaps and clog_mm < _MIN_CLOG_MM, left, mend.left_mm)
        try:
            record = self.find_record(look.number)
            if record is not None and mend.mended:  # another observer looks there
                found = {**record.found, "mended": list(mend.mended)}
                amend_look(self.folder, replace(record, found=found))
            again = bool(mend.mended)
            self.link.insert(look.number, mend.lines, decision.why, decision.factor, again)
        except Refused as exc:
            log.warning("look %d: %s", look.number, exc)
            return _Insertion(False, f"; the link refused the mend: {exc}")
        return _Insertion(True, left, mend.left_mm)


_NOT_JUDGED_REASON: Final = (
    "not judged: by somebody's word the print went on, or ended, before; nothing was mended"
)


@dataclass(frozen=True)
class _Insertion:
    """Outcome of a mend: whether it is in the job, and what it leaves unmended."""

    done: bool
    left: str
    left_mm: float = 0.0
    given_up: bool = False


def _by_single_picture(judged: LookJudgement, why: DeviceError) -> LookJudgement:
    """Return the judgement by one picture alone, without thin lines, which need two."""
    return replace(
        judged, evidence=replace(judged.evidence, thin=(), single_picture_reason=str(why))
    )


def _with_left_mm(found: dict[str, Any], left_mm: float) -> dict[str, Any]:
    """Return a look's figures with the length of the gaps left, if any."""
    rest = {name: value for name, value in found.items() if name != "left_mm"}
    return {**rest, "left_mm": round(left_mm, 3)} if left_mm else rest
