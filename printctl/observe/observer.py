"""Handle each inspection hold of a print: acquire a picture, judge, decide, act, record.

The observer is a client of the link process. It may die at any moment: the link holds the needle
out of the bath until a look is decided, and pauses the print for the operator when nobody decides.
What has been decided is in the link's journal, so a look is never acted on twice; what the flow
control knew is in the record of each look, so a new observer goes on from there.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Protocol

from printctl.machine.errors import LinkError, Refused
from printctl.observe.deciding import Decider, Decision, DecisionKind
from printctl.observe.deciding.evidence import Thin
from printctl.observe.deciding.flow_control import Answers, Reading
from printctl.observe.devices import DeviceError, picture_of
from printctl.observe.learned import STATE
from printctl.observe.look_values import Judged, Look, MendLines
from printctl.observe.records import (
    POSTPONED,
    Answer,
    LookRecord,
    amend_look,
    answer_of,
    emptied_look_folder,
    look_folder,
    read_looks,
    save_look,
)
from registration.inspection.values import Gap

# State of a decider: what it has learned so far, as each look's record keeps it.


def state_of(decider: Decider) -> dict[str, Any]:
    """Return what `restore` needs, ready for JSON."""
    control = decider.control
    return {
        "log_flow": control.log_flow,
        "misread": control.misread,
        "flow_variance": list(control.variance),
        "time_s": control.time_s,
        "common": control.common,
        "answers": asdict(control.answers),
        "flow_asked": control.asked,
        "beyond_said": control.beyond_said,
        "last_shift_mm": decider.last_shift_mm,
        "unseen_mm": decider.unseen_mm,
        "unseen": [asdict(one) for one in decider.unseen],
        "failed": decider.failed,
        "blind_said": decider.blind_said,
    }


def restore(decider: Decider, state: dict[str, Any]) -> None:
    """Set a decider to a state of `state_of`; what an older release's lacks isn't known."""
    control = decider.control
    control.log_flow, control.time_s = state["log_flow"], state["time_s"]
    if "flow_variance" in state:
        flow, both, misread = state["flow_variance"]
        control.variance, control.misread = (flow, both, misread), state["misread"]
        control.common, control.asked = state["common"], state["flow_asked"]
    else:
        control.variance = (state["variance"], 0.0, 0.0)
    control.beyond_said = state.get("beyond_said", False)
    answers = dict(state.get("answers", {}))
    last = answers.pop("last", None)
    control.answers = Answers(**answers, last=None if last is None else Reading(**last))
    decider.last_shift_mm = state["last_shift_mm"]
    decider.unseen_mm = state.get("unseen_mm", 0.0)
    decider.unseen = [Gap(**one) for one in state.get("unseen", ())]
    decider.failed = state.get("failed", False)
    decider.blind_said = state.get("blind_said", False)


class PrintLink(Protocol):
    """What the observer asks of a print's link."""

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str,
        flow: float | None = None,
        again: bool = False,
    ) -> object:
        """Put lines into the job where it is held, and correct the flow of its rest.

        With ``again`` another look is made once they are written.
        """

    def look_done(self, look: int, decision: str, why: str, again: bool = False) -> None:
        """End a look: ``go_on``, ``pause`` or ``stop``; ``again`` where it failed."""

    def resume(self) -> None:
        """Go on after a pause."""

    def stop(self) -> None:
        """Stop the print."""


log = logging.getLogger(__name__)
_ANSWER_POLL_S: Final = 0.2
_HARDLY: Final = 0.1
"""Share of the lines: of a picture taken too early a part may lie over bath."""
_MOST: Final = 0.5
"""Of a line's ink, which is missing along `_THIN_MM`: a clog in part, that isn't left untold."""
_THIN_MM: Final = 2.0


@dataclass
class Observer:
    """One print's observer.

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
        Whether the print is over, or goes on from the look that was asked about.
    begun : float, s since 1970
        Of the print: earlier records in the folder are another print's.
    clock : callable
        Seconds since 1970.
    """

    folder: Path
    link: PrintLink
    acquire: Callable[[Look, Path], Path]
    judge: Callable[[Look, Path, Path | None], Judged]
    mend_lines: Callable[[Look, tuple[Gap, ...], tuple[Thin, ...], float, bool], MendLines]
    decider: Decider
    ended: Callable[[int], bool]
    begun: float = 0.0
    clock: Callable[[], float] = time.time

    def __post_init__(self) -> None:
        self._new = state_of(self.decider)

    def remember(self, number: int) -> None:
        """Know what the looks before one told: those of an observer that died, too, none twice."""
        looks = [one for one in read_looks(self.folder, self.begun) if one.number < number]
        restore(self.decider, looks[-1].control if looks else self._new)

    def look(self, look: Look) -> LookRecord:
        """Look, judge, decide and act; nothing that a device does raises.

        Raises
        ------
        LinkError
            When the link can't be told.
        OSError
            When the record can't be written: the look then stays undecided, and the link pauses.
        """
        place = emptied_look_folder(self.folder, look.number)
        begun = self.clock()
        try:
            judged = self._judged(look, place)
        except DeviceError as exc:
            record = self._record(look, DecisionKind.PAUSE, f"nothing seen: {exc}", {}, begun)
            save_look(self.folder, record)
            self.link.look_done(look.number, "pause", record.why, again=True)
            return record
        if self._over(look.number):
            return self._went_on(look, begun)
        decision = self._decided(judged)
        found = _with_left(judged.found, math.fsum(gap.length_mm for gap in decision.gaps))
        record = replace(
            self._record(look, decision.kind, decision.why, found, begun),
            asked=decision.ask.value if decision.ask else "",
            factor=decision.factor,
        )
        if judged.learned:
            record = replace(record, control={**record.control, STATE: judged.learned})
        save_look(self.folder, record)
        self._act(look, decision)
        return self._kept(look.number) or record

    def _over(self, number: int) -> bool:
        """Whether somebody else has ended a look; a link that is silent hasn't."""
        try:
            return self.ended(number)
        except LinkError:
            return False

    def _went_on(self, look: Look, begun: float) -> LookRecord:
        """Keep a record of a look that somebody ended before it was judged.

        Its pictures may show what was written since, so what they tell isn't kept.
        """
        why = (
            "not judged: by somebody's word the print went on, or ended, before; nothing was mended"
        )
        record = self._record(look, DecisionKind.GO_ON, why, {}, begun)
        save_look(self.folder, record)
        return record

    def note_failure(self, look: Look, why: str) -> None:
        """Keep a record of a look that failed: what is written there wasn't looked at.

        Raises
        ------
        OSError
            When it can't be written.
        """
        kept = self._kept(look.number)
        if kept is not None:
            amend_look(self.folder, replace(kept, why=f"{kept.why}; {why}", asked=""))
            return
        self.remember(look.number)
        save_look(self.folder, self._record(look, DecisionKind.PAUSE, why, {}, self.clock()))

    def _decided(self, judged: Judged) -> Decision:
        self.decider.control.put_in_force(judged.flow)
        if POSTPONED in judged.found:
            share = judged.evidence.seen_share
            why = f"{share:.0%} was seen of a part of a vessel: the next look judges it, too"
            return Decision(DecisionKind.GO_ON, why)
        decision = self.decider.decide(judged.evidence)
        unseen = judged.found.get("not_seen")
        return replace(decision, why=f"{decision.why} ({unseen})") if unseen else decision

    def _judged(self, look: Look, place: Path) -> Judged:
        """Judge one picture; another has the last word on gaps, thin lines and vessels not seen.

        A picture in which hardly anything is seen is taken anew: a device that takes them by itself
        may have begun with it before the needle was held, and one that hangs gives the same again.
        Where no other comes (a program that takes one at each look), the first alone tells.
        """
        picture = self.acquire(look, place / "picture")
        judged = self.judge(look, picture, None)
        if judged.evidence.seen_share < _HARDLY and not look.within_vessel:
            try:
                picture = self.acquire(look, place / "picture")
            except DeviceError as exc:
                return _by_one(judged, exc)
            judged = self.judge(look, picture, None)
        limits, evidence = self.decider.limits, judged.evidence
        gaps = any(limits.gap.significant(gap, evidence.places) for gap in evidence.gaps)
        if look.within_vessel and not gaps and evidence.seen_share < limits.least_seen:
            return replace(judged, found={**judged.found, POSTPONED: True})
        if gaps or evidence.thin or evidence.unseen:
            try:
                again = self.acquire(look, place / "again")
            except DeviceError as exc:
                return _by_one(judged, exc)
            judged = self.judge(look, picture, again)
        return judged

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

    def _act(self, look: Look, decision: Decision) -> None:
        if decision.ask is not None:
            self._ask(look, decision, decision.why)
        elif decision.kind in (DecisionKind.MEND, DecisionKind.FLOW):
            self._insert(look, decision)
        elif decision.kind is DecisionKind.PAUSE and decision.factor is not None:
            put = self._put_in(look, decision)
            self.link.look_done(look.number, decision.kind.value, f"{decision.why}{put.left}")
        else:
            self.link.look_done(look.number, decision.kind.value, decision.why)

    def _ask(self, look: Look, decision: Decision, why: str) -> None:
        """Pause, and wait for the operator's word; the needle stays out of the bath."""
        self.link.look_done(look.number, "pause", why)
        self._do_as_told(look, decision)

    def ask_again(self, look: Look) -> None:
        """Go on waiting for the operator's word on a look whose observer died, by its pictures."""
        place = look_folder(self.folder, look.number)
        picture = picture_of(place, "picture")
        if picture is None:
            raise DeviceError(f"the look's picture isn't in {place} any more")
        judged = self.judge(look, picture, picture_of(place, "again"))
        self._do_as_told(look, self._decided(judged))

    def _do_as_told(self, look: Look, decision: Decision) -> None:
        answer = self._await_answer(look.number)
        if answer == "approve":
            put = self._put_in(look, decision, approved=True)
            if put.done:
                self._amend(look, f"{decision.why}{put.left}", put.left_mm)
                self.go_on(look.number)
            else:
                then = "it can't be mended from here: resume goes on without, stop ends it"
                self._amend(look, f"{decision.why}{put.left}; approved, but {then}", asked="")
        elif answer == "go_on":
            self.go_on(look.number)
        elif answer == "stop":
            self.link.stop()

    def go_on(self, number: int) -> None:
        """Resume as the operator has said; say so where the link waits for something else first."""
        try:
            self.link.resume()
        except Refused as exc:
            record, said = self._kept(number), f"; not gone on yet: {exc}"
            log.warning("look %d%s", number, said)
            if record is not None and said not in record.why:
                amend_look(self.folder, replace(record, why=record.why + said))

    def _amend(self, look: Look, why: str, left_mm: float | None = None, **changes: Any) -> None:
        """Say on a look's record what came of its decision, and what it left where that is new."""
        record = self._kept(look.number)
        if record is not None:
            found = record.found if left_mm is None else _with_left(record.found, left_mm)
            amend_look(self.folder, replace(record, why=why, found=found, **changes))

    def _kept(self, number: int) -> LookRecord | None:
        own = [one for one in read_looks(self.folder, self.begun) if one.number == number]
        return own[0] if own else None

    def _await_answer(self, number: int) -> Answer | None:
        """Return the operator's word; None where the print went on or ended without it."""
        while (answer := answer_of(self.folder, number)) is None:
            if self.ended(number):
                return None
            time.sleep(_ANSWER_POLL_S)
        return answer

    def _insert(self, look: Look, decision: Decision) -> None:
        put = self._put_in(look, decision)
        why = f"{decision.why}{put.left}"
        if put.done:
            self._amend(look, why, put.left_mm)
            self.link.look_done(look.number, "go_on", why)
            return
        pause = DecisionKind.PAUSE.value
        if put.given_up:
            mend = DecisionKind.MEND.value
            self._amend(look, why, decision=pause, asked=mend)  # nothing is mended: all stays left
            self._ask(look, decision, why)
            return
        why = f"{why}; it can't be mended from here"
        self._amend(look, why, decision=pause)
        self.link.look_done(look.number, "pause", why)

    def _put_in(self, look: Look, decision: Decision, approved: bool = False) -> _Put:
        """Put mend and flow into the job, and say what is left as it is.

        What was written in vain before is written again where the operator has approved it alone.
        """
        flow = decision.factor or self.decider.control.factor
        gaps, thin = decision.gaps, decision.thin
        none = MendLines()
        mend = self.mend_lines(look, gaps, thin, flow, approved) if gaps or thin else none
        left = f"; not mended: {mend.left}" if mend.left else ""
        if mend.given_up:
            return _Put(False, left, given_up=True)
        if not mend.lines and decision.factor is None:
            return _Put(not gaps and not _hardly_any_ink(thin), left, mend.left_mm)
        try:
            self._note_mended(look, mend)
            again = bool(mend.mended)
            self.link.insert(look.number, mend.lines, decision.why, decision.factor, again)
        except Refused as exc:
            log.warning("look %d: %s", look.number, exc)
            return _Put(False, f"; the link refused the mend: {exc}")
        return _Put(True, left, mend.left_mm)

    def _note_mended(self, look: Look, mend: MendLines) -> None:
        """Keep with a look's record what its mend writes again: another observer looks there."""
        record = self._kept(look.number)
        if record is not None and mend.mended:
            found = {**record.found, "mended": list(mend.mended)}
            amend_look(self.folder, replace(record, found=found))


def _hardly_any_ink(thin: Sequence[Thin]) -> bool:
    """Whether so much lacks most of its ink that the operator is to know; other thin lines stay."""
    way_mm = math.fsum(one.length_mm for one in thin if one.missing > _MOST)
    return way_mm >= _THIN_MM


@dataclass(frozen=True)
class _Put:
    """What came of a mend: whether it is in the job, and what it leaves as it is."""

    done: bool
    left: str
    left_mm: float = 0.0
    given_up: bool = False


def _by_one(judged: Judged, why: DeviceError) -> Judged:
    """Return what one picture tells where no other came; thin lines want two."""
    return replace(judged, evidence=replace(judged.evidence, thin=(), alone=str(why)))


def _with_left(found: dict[str, Any], left_mm: float) -> dict[str, Any]:
    """Figures of a look with the length of its gaps that stay as they are, where there are any."""
    rest = {name: value for name, value in found.items() if name != "left_mm"}
    return {**rest, "left_mm": round(left_mm, 3)} if left_mm else rest
