"""State of inspection holds (looks): the current one, decisions, inserts, repeated requests."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from printctl.machine.errors import Refused
from printctl.machine.job.inserts import Insert

Answer = dict[str, Any]


class LookDecision(StrEnum):
    """Decision that ends a look."""

    GO_ON = "go_on"
    PAUSE = "pause"
    STOP = "stop"


@dataclass(frozen=True)
class Look:
    """A look that is going on, or from which the print is still held.

    Attributes
    ----------
    number : int
        From 1, in the print's order.
    done : int
        Command lines taken, earlier inserts among them.
    mark : str
        What ended there, in words.
    layer : int
        Of the mark of a layer that ended last; -1 where the job names none.
    since : float
        Wall-clock time, s since 1970.
    limit_s : float, s
        From then on, after which it becomes a pause.
    """

    number: int
    done: int
    mark: str
    layer: int
    since: float
    limit_s: float

    def __str__(self) -> str:
        return f"look {self.number} at the {self.mark}"


@dataclass(frozen=True)
class LookRequest:
    """A client's insert or decision; answered by the thread that speaks to the printer.

    Attributes
    ----------
    look : int
    done, refused : callable
        Given the answer once it is in the journal, or the reason of a refusal.
    why : str
        For the journal.
    decision : LookDecision or None
        None for an insert.
    lines : tuple of str
        To be inserted, one command each.
    flow : float or None
        With an insert: what moves that write push from there on, over what the file says; None
        for as before.
    again : bool
        With a pause: the look failed, and is made again when the print goes on. With an insert:
        another look is made once its lines are written.
    """

    look: int
    done: Callable[[Answer], None]
    refused: Callable[[str], None]
    why: str = ""
    decision: LookDecision | None = None
    lines: tuple[str, ...] = ()
    flow: float | None = None
    again: bool = False


@dataclass
class LookBook:
    """Looks of one print: written by the thread that speaks to the printer, read by any.

    Attributes
    ----------
    current : Look or None
        The look that the print is held for, until it goes on; a pause that came of it, too.
    decisions : dict
        The journal's record of each decision, by look.
    inserts : dict
        Each insert and its lines as the client sent them, by look.
    """

    current: Look | None = None
    decisions: dict[int, Mapping[str, Any]] = field(default_factory=dict)
    inserts: dict[int, tuple[Insert, tuple[str, ...]]] = field(default_factory=dict)

    # --- for any thread --------------------------------------------------------------------------

    def status(self) -> dict[str, Any] | None:
        """Return the current look for clients; None where the print isn't held for one."""
        look = self.current
        if look is None:
            return None
        insert, decision = self.inserts.get(look.number), self.decisions.get(look.number)
        return {
            "number": look.number,
            "mark": look.mark,
            "layer": look.layer,
            "done": look.done,
            "since": look.since,
            "limit_s": look.limit_s,
            "inserted": 0 if insert is None else len(insert[0].lines),
            "insert_sha256": "" if insert is None else insert[0].sha256,
            "decision": "" if decision is None else str(decision["decision"]),
        }

    def repeated(self, request: LookRequest) -> Answer | None:
        """Return the answer to a repeated request; None for a new one.

        Raises
        ------
        Refused
            When it contradicts an earlier one, or is about no look that is going on.
        """
        if request.decision is None:
            return self._repeated_insert(request)
        before, look = self.decisions.get(request.look), self.current
        if before is None:
            self._refuse_other(request.look)
            return None
        if before["decision"] == request.decision:
            return decision_answer(before)
        held = look is not None and look.number == request.look
        how = "; `printctl resume RUN` goes on" if held else ""
        raise Refused(
            f"look {request.look} was decided before: {before['decision']} ({before['why']}), "
            f"not {request.decision}{how}"
        )

    def _repeated_insert(self, request: LookRequest) -> Answer | None:
        before = self.inserts.get(request.look)
        if before is None:
            self._refuse_other(request.look)
            return None
        insert, texts = before
        same = request.lines == texts or _bare(request.lines) == _bare(_texts(insert))
        if same and request.flow in (None, insert.flow):
            return insert_answer(insert)
        raise Refused(
            f"look {request.look} has an insert of {len(insert.lines)} lines already, other ones: "
            "a look has one; what is still missing is for the next look"
        )

    def _refuse_other(self, number: int) -> None:
        look = self.current
        if look is None:
            raise Refused(
                f"the print isn't held for look {number}, nor for any: wait until its status says "
                "looking"
            )
        if look.number != number:
            raise Refused(f"the print is held for look {look.number}, not for look {number}")

    # --- for the thread that speaks to the printer -----------------------------------------------

    def restore(self, decisions: Iterable[Mapping[str, Any]], inserts: Iterable[Insert]) -> None:
        """Take the journal's records of a process that died."""
        self.decisions = {int(one["look"]): one for one in decisions}
        self.inserts = {one.look: (one, _texts(one)) for one in inserts}

    def begin(self, done: int, mark: str, layer: int, limit_s: float) -> Look:
        """Begin the look after the last that was decided.

        Where the print wasn't gone on with since an insert (it died in the pause of that look), the
        insert is this look's as well, so that no client puts in another for the same gap.
        """
        number = max(self.decisions, default=0) + 1
        for insert, texts in list(self.inserts.values()):
            if insert.after == done:
                self.inserts[number] = replace(insert, look=number), texts
        self.current = Look(number, done, mark, layer, time.time(), limit_s)
        return self.current

    def failed_before(self, look: Look) -> bool:
        """Whether the look before this one, at the same place, failed as well."""
        record = self.decisions.get(look.number - 1, {})
        return bool(record.get("again")) and int(record["done"]) == look.done


def insert_answer(insert: Insert) -> Answer:
    """Return a client's answer for an insert that is in the journal."""
    return {
        "event": "inserted",
        "look": insert.look,
        "after": insert.after,
        "count": len(insert.lines),
        "sha256": insert.sha256,
        "flow": insert.flow,
    }


def decision_answer(record: Mapping[str, Any]) -> Answer:
    """Return a client's answer for a decision that is in the journal."""
    return {"event": "looked", **{name: record[name] for name in ("look", "decision", "why")}}


def _texts(insert: Insert) -> tuple[str, ...]:
    return tuple(line.decode("ascii") for line in insert.lines)


def _bare(texts: Iterable[str]) -> list[str]:
    """Commands without comments and blanks at their ends."""
    bare = (text.partition(";")[0].strip() for text in texts)
    return [text for text in bare if text]
