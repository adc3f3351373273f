"""State of inspection holds (looks): the current one, decisions, inserts, repeated requests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

from printctl.machine.errors import Refused
from printctl.machine.job.job import Insert

Answer = dict[str, Any]


class LookDecision(StrEnum):
    """Decision that ends a look."""

    GO_ON = "go_on"
    PAUSE = "pause"
    STOP = "stop"


@dataclass(frozen=True)
class Look:
    """A look that is going on, or from which the print is still held."""

    number: int  # from 1, in the print's order
    mark: str  # what ended there, in words
    layer: int  # the last one whose end is marked; -1 where the job names none
    done: int  # command lines taken, earlier inserts among them
    since: float  # wall-clock time, s since 1970
    limit_s: float  # from then on, after which it becomes a pause

    def __str__(self) -> str:
        return f"look {self.number} at the {self.mark}"


@dataclass(frozen=True)
class LookRequest:
    """A client's insert or decision; answered by the thread that speaks to the printer.

    ``flow``: what moves that write push from there on, over what the file says; None for as before.
    ``again`` with a pause: the look failed, and is made again when the print goes on; with an
    insert: another look is made once its lines are written.
    """

    look: int
    done: Callable[[Answer], None]  # given the answer once it is in the journal
    refused: Callable[[str], None]  # given the reason
    why: str = ""
    decision: LookDecision | None = None  # None for an insert
    lines: tuple[str, ...] = ()  # of an insert, one command each
    flow: float | None = None
    again: bool = False


@dataclass
class LookBook:
    """Looks of one print: written by the thread that speaks to the printer, read by any."""

    # that the print is held for, until it goes on: a pause that came of it, too
    current: Look | None = None
    # the journal's record of each decision, by look
    decisions: dict[int, Mapping[str, Any]] = field(default_factory=dict)
    # each insert, and its lines as they were sent, by look
    inserts: dict[int, tuple[Insert, tuple[str, ...]]] = field(default_factory=dict)

    def status(self) -> dict[str, Any] | None:
        """Return the current look for clients; None where the print isn't held for one."""
        look = self.current
        if look is None:
            return None
        insert, decision = self.inserts.get(look.number), self.decisions.get(look.number)
        return {
            **asdict(look),
            "inserted": 0 if insert is None else len(insert[0].lines),
            "insert_sha256": "" if insert is None else insert[0].sha256,
            "decision": "" if decision is None else str(decision["decision"]),
        }

    def repeated(self, request: LookRequest) -> Answer | None:
        """Return the answer to a repeated request; None for a new one.

        `Refused` when it contradicts an earlier one, or is about no look that is going on.
        """
        number, look = request.look, self.current
        insert, decision = self.inserts.get(number), self.decisions.get(number)
        if request.decision is None and insert is not None:
            return _repeated_insert(request, *insert)
        if request.decision is not None and decision is not None:
            if decision["decision"] == request.decision:
                return decision_answer(decision)
            held = look is not None and look.number == number
            how = "; `printctl resume RUN` continues" if held else ""
            raise Refused(
                f"look {number} was decided before: {decision['decision']} ({decision['why']}), "
                f"not {request.decision}{how}"
            )
        if look is None:
            raise Refused(
                f"the print isn't held for look {number} or any other: wait until its status is "
                "looking"
            )
        if look.number != number:
            raise Refused(f"the print is held for look {look.number}, not for look {number}")
        return None

    def restore(self, decisions: Iterable[Mapping[str, Any]], inserts: Iterable[Insert]) -> None:
        """Take the journal's records of a process that died."""
        self.decisions = {int(one["look"]): one for one in decisions}
        self.inserts = {one.look: (one, _texts(one)) for one in inserts}

    def begin(self, done: int, mark: str, layer: int, since: float, limit_s: float) -> Look:
        """Begin the look after the last that was decided; ``since``: wall-clock time, s.

        Where the print wasn't gone on with since an insert (it died in the pause of that look), the
        insert is this look's as well, so that no client puts in another for the same gap.
        """
        number = max(self.decisions, default=0) + 1
        for insert, texts in list(self.inserts.values()):
            if insert.after == done:
                self.inserts[number] = replace(insert, look=number), texts
        self.current = Look(number, mark, layer, done, since, limit_s)
        return self.current

    def failed_before(self, look: Look) -> bool:
        """Whether the look before this one, at the same place, failed as well."""
        record = self.decisions.get(look.number - 1, {})
        return bool(record.get("again")) and int(record["done"]) == look.done


def _repeated_insert(request: LookRequest, insert: Insert, texts: tuple[str, ...]) -> Answer:
    same = request.lines == texts or _bare(request.lines) == _bare(_texts(insert))
    if same and request.flow in (None, insert.flow):
        return insert_answer(insert)
    raise Refused(
        f"look {request.look} has injected G-code of {len(insert.lines)} lines already, other "
        "ones: a look has one; what is still missing is for the next look"
    )


def insert_answer(insert: Insert) -> Answer:
    """Return a client's answer for an insert that is in the journal."""
    size = {"after": insert.after, "count": len(insert.lines)}
    what = {"sha256": insert.sha256, "flow": insert.flow}
    return {"event": "inserted", "look": insert.look, **size, **what}


def decision_answer(record: Mapping[str, Any]) -> Answer:
    """Return a client's answer for a decision that is in the journal."""
    return {"event": "looked", **{name: record[name] for name in ("look", "decision", "why")}}


def _texts(insert: Insert) -> tuple[str, ...]:
    return tuple(line.decode("ascii") for line in insert.lines)


def _bare(texts: Iterable[str]) -> list[str]:
    """Commands without comments and blanks at their ends."""
    bare = (text.partition(";")[0].strip() for text in texts)
    return [text for text in bare if text]
