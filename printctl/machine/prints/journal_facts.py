"""Read from a print's journal its active time without pauses and its syringe changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from printctl.machine.prints.inserted_ink import InsertedInk, inserted_ink
from printctl.machine.records.journal import print_id, read_records
from printctl.machine.records.replay import times_words
from printctl.machine.records.states import LinkState

_AT_WORK: Final = (LinkState.PRINTING, LinkState.PAUSING)
"""In both the job's moves are made: a pause is reached when those that were sent are done."""


@dataclass(frozen=True)
class JournalledFacts:
    """Facts of a print so far, from its journal.

    Attributes
    ----------
    print_id : str
        Identity of the print.
    sha256 : str
        Of the file that is printed.
    started : float
        Wall-clock time, s since 1970.
    active_s : float, s
        Time in which it was printing, pauses left out, up to ``since`` or the end.
    since : float or None
        Since when it has been printing without a pause; None while it isn't.
    filled : (int, float, float) or None
        Commands before the last change of syringe; of the one put in the travel used up and that
        of a full one (0 where unknown), mm.
    paces : tuple of (int, float)
        Commands taken and time without pauses, s, at each checkpoint.
    last_alarm : str
    stood_mm : (x, y, z) or None, mm
        Where the printer said that it stood when the print's end dropped its moves.
    inserts : tuple of InsertedInk
        What was put into the job.
    heard_at : float
        When the last record was written, s since 1970.
    """

    print_id: str = ""
    sha256: str = ""
    started: float = 0.0
    active_s: float = 0.0
    since: float | None = None
    filled: tuple[int, float, float] | None = None
    paces: tuple[tuple[int, float], ...] = ()
    last_alarm: str = ""
    stood_mm: tuple[float, float, float] | None = None
    inserts: tuple[InsertedInk, ...] = ()
    heard_at: float = 0.0

    def active_until(self, now: float) -> float:
        """Time without pauses until ``now``, s."""
        return self.active_s + (max(now - self.since, 0.0) if self.since is not None else 0.0)


def read_journal_facts(path: Path) -> JournalledFacts:
    """Read a journal; an absent one counts as empty."""
    try:
        return read_so_far(record for record in read_records(path) if record)
    except OSError:
        return JournalledFacts()


def read_so_far(records: Iterable[dict[str, Any]]) -> JournalledFacts:
    """Read the last print of a journal's records."""
    facts, paces, heard_at = JournalledFacts(), list[tuple[int, float]](), 0.0
    for record in records:
        sort, at = record.get("t"), float(record.get("at", 0.0))
        if sort == "job":
            facts, before = _begun(facts, record, heard_at), facts
            paces = paces if before.print_id == facts.print_id else []
        elif sort in ("state", "end"):
            facts = _changed(facts, record.get("state") in _AT_WORK and sort == "state", at)
        elif sort == "syringe":
            used, full = (float(record.get(k, 0.0)) for k in ("plunger_mm", "capacity_mm"))
            facts = _with(facts, filled=(int(record.get("done", 0)), used, full))
        elif sort == "insert":
            facts = _with(facts, inserts=(*facts.inserts, inserted_ink(record)))
        elif sort == "alarm":
            facts = _with(facts, last_alarm=str(record.get("text", "")))
        elif sort == "repeated":
            facts = _with(facts, last_alarm=times_words(record))
        elif sort == "stood":
            facts = _with(facts, stood_mm=_place(record.get("place") or {}))
        elif sort == "checkpoint" and facts.since is not None:
            paces.append((int(record.get("done", 0)), facts.active_until(at)))
        heard_at = max(at, heard_at)
    return _with(facts, paces=tuple(paces), heard_at=heard_at)


def _place(told: Mapping[str, Any]) -> tuple[float, float, float] | None:
    x, y, z = (told.get(axis) for axis in "xyz")
    return None if x is None or y is None or z is None else (float(x), float(y), float(z))


def _begun(before: JournalledFacts, record: dict[str, Any], heard_at: float) -> JournalledFacts:
    """A job record begins a print, or goes on with one that was last heard at ``heard_at``."""
    sha256, at = str(record.get("sha256", "")), float(record.get("started", 0.0))
    same = before.sha256 == sha256 and record.get("id") in (None, before.print_id)
    if before.sha256 and same:
        # Where its process died, nobody knows for how long it went on after its last record.
        active_s = before.active_until(heard_at)
        return _with(before, active_s=active_s, since=None, stood_mm=None)
    return JournalledFacts(print_id(record), sha256, at)


def _changed(before: JournalledFacts, works: bool, at: float) -> JournalledFacts:
    if works:
        return before if before.since is not None else _with(before, since=at)
    return _with(before, active_s=before.active_until(at), since=None)


def _with(before: JournalledFacts, **changes: Any) -> JournalledFacts:
    return JournalledFacts(**{**vars(before), **changes})
