"""State of inspection holds (looks): the current one, decisions, inserts, answers already given."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from printctl.machine.errors import Refused
from printctl.machine.job.job import Insert

Answer = dict[str, Any]


class LookDecision(StrEnum):
    """What a look ends with."""

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


@dataclass(frozen=True)
class LookWord:
    """What a client said of a look; the thread that speaks to the printer answers.

    Attributes
    ----------
    look : int
    lines : tuple of str
        To be inserted; empty for a decision.
    decision : LookDecision or None
    why : str
    done : callable
        Given the answer.
    refused : callable
        Told why not.
    flow : float or None
        With an insert: what moves that write push from there on, over what the file says; None
        for as before.
    again : bool
        With a pause: the look failed, and is made again when the print goes on. With an insert:
        another look is made once its lines are written.
    """

    look: int
    lines: tuple[str, ...]
    decision: LookDecision | None
    why: str
    done: Callable[[Answer], None]
    refused: Callable[[str], None]
    flow: float | None = None
    again: bool = False


class LookBook:
    """Written by the thread that speaks to the printer, read by any.

    Attributes
    ----------
    current : Look or None
        The look that the print is held for, until it goes on; a pause that came of it, too.
    """

    def __init__(self) -> None:
        self.current: Look | None = None
        self._decided: dict[int, Mapping[str, Any]] = {}
        self._inserts: dict[int, tuple[Insert, tuple[str, ...]]] = {}

    # --- for any thread --------------------------------------------------------------------------

    def told(self) -> dict[str, Any] | None:
        """Return the look as clients are told of it; None where the print isn't held for one."""
        look = self.current
        if look is None:
            return None
        insert = self._inserts.get(look.number)
        decided = self._decided.get(look.number)
        return {
            "number": look.number,
            "mark": look.mark,
            "layer": look.layer,
            "done": look.done,
            "since": look.since,
            "limit_s": look.limit_s,
            "inserted": 0 if insert is None else len(insert[0].lines),
            "insert_sha256": "" if insert is None else insert[0].sha256,
            "decision": "" if decided is None else str(decided["decision"]),
        }

    def answer(self, word: LookWord) -> Answer | None:
        """Return the answer to a word that was said before; None for a new one.

        Raises
        ------
        Refused
            When it contradicts what was said before, or is about no look that is going on.
        """
        if word.decision is None:
            return self._answer_insert(word)
        decided = self._decided.get(word.look)
        if decided is not None:
            if decided["decision"] == word.decision:
                return decided_answer(decided)
            how = "; `printctl resume RUN` goes on" if self._held(word.look) else ""
            raise Refused(
                f"look {word.look} was decided before: {decided['decision']} ({decided['why']}), "
                f"not {word.decision}{how}"
            )
        self._refuse_other(word.look)
        return None

    def _answer_insert(self, word: LookWord) -> Answer | None:
        before = self._inserts.get(word.look)
        if before is not None:
            insert, texts = before
            same = word.lines == texts or _bare(word.lines) == _bare(_texts(insert))
            if same and word.flow in (None, insert.flow):
                return insert_answer(insert)
            raise Refused(
                f"look {word.look} has an insert of {len(insert.lines)} lines already, other ones: "
                "a look has one; what is still missing is for the next look"
            )
        self._refuse_other(word.look)
        return None

    def _refuse_other(self, number: int) -> None:
        look = self.current
        if look is None:
            raise Refused(
                f"the print isn't held for look {number}, nor for any: wait until its status says "
                "looking"
            )
        if look.number != number:
            raise Refused(f"the print is held for look {look.number}, not for look {number}")

    def _held(self, number: int) -> bool:
        return self.current is not None and self.current.number == number

    # --- for the thread that speaks to the printer -----------------------------------------------

    def restore(self, decided: Iterable[Mapping[str, Any]], inserts: Iterable[Insert]) -> None:
        """Take what a process that died has written down."""
        self._decided = {int(one["look"]): one for one in decided}
        self._inserts = {one.look: (one, _texts(one)) for one in inserts}

    def begin(self, done: int, mark: str, layer: int, limit_s: float) -> Look:
        """Take notice that a look begins: the one after the last that was decided.

        Where the print wasn't gone on with since an insert (it died in the pause of that look), the
        insert is this look's as well, so that nobody puts in another for the same gap.
        """
        number = max(self._decided, default=0) + 1
        for insert, texts in list(self._inserts.values()):
            if insert.after == done:
                self._inserts[number] = replace(insert, look=number), texts
        self.current = Look(number, done, mark, layer, time.time(), limit_s)
        return self.current

    def decide(self, record: Mapping[str, Any]) -> None:
        """Take notice of a decision; ``record`` as the journal has it."""
        self._decided[int(record["look"])] = record

    def decided(self, number: int) -> bool:
        """Whether a look was decided."""
        return number in self._decided

    def has_insert(self, number: int) -> bool:
        """Whether lines were put into the job at a look."""
        return number in self._inserts

    def failed_before(self, look: Look) -> bool:
        """Whether the look before this one, at the same place, failed as well."""
        record = self._decided.get(look.number - 1, {})
        return bool(record.get("again")) and int(record["done"]) == look.done

    def insert(self, insert: Insert, texts: tuple[str, ...]) -> None:
        """Take notice of an insert, sent as ``texts``."""
        self._inserts[insert.look] = insert, texts

    def end(self) -> None:
        """Take notice that the print goes on."""
        self.current = None


def insert_answer(insert: Insert) -> Answer:
    """What a client is told of an insert that is in the journal."""
    return {
        "event": "inserted",
        "look": insert.look,
        "after": insert.after,
        "count": len(insert.lines),
        "sha256": insert.sha256,
        "flow": insert.flow,
    }


def decided_answer(record: Mapping[str, Any]) -> Answer:
    """What a client is told of a decision that is in the journal."""
    told = {name: record[name] for name in ("look", "decision", "why")}
    return {"event": "looked", **told}


def _texts(insert: Insert) -> tuple[str, ...]:
    return tuple(line.decode("ascii") for line in insert.lines)


def _bare(texts: Iterable[str]) -> list[str]:
    """Commands without comments and blanks at their ends."""
    bare = (text.partition(";")[0].strip() for text in texts)
    return [text for text in bare if text]
