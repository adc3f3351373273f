"""Timeline of a print: events (pauses, alarms, syringe changes) and the states it went through."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from printctl.machine.records.folders import plain_text
from printctl.machine.records.journal import Record, read_records
from printctl.machine.records.record import reported_port
from printctl.machine.records.replay import times_words

MOST: Final = 2000
"""Events that are told; a print with more has them in its journal."""
_HOLDS: Final = ("pausing", "paused", "looking")


@dataclass(frozen=True)
class Event:
    """Event of a print.

    Attributes
    ----------
    at : float, s since 1970
    kind : str
        begun, state, action, alarm, checkpoint, look, insert, reload, syringe, end, damaged.
    text : str
    after_s : float, s
        Since the print began.
    """

    at: float
    kind: str
    text: str
    after_s: float


@dataclass(frozen=True)
class Stretch:
    """Period in one state.

    Attributes
    ----------
    state : str
    start_s, end_s : float, s
        Since the print began.
    """

    state: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class TimeLine:
    """A print's events, and the states that it went through.

    Attributes
    ----------
    events : tuple of Event
        The first `MOST`.
    stretches : tuple of Stretch
    more : int
        Events that aren't told.
    """

    events: tuple[Event, ...]
    stretches: tuple[Stretch, ...]
    more: int = 0

    @property
    def held_s(self) -> float:
        """How long it didn't go on because it was held, s."""
        return sum(one.end_s - one.start_s for one in self.stretches if one.state in _HOLDS)


def time_line(journal: Path) -> TimeLine:
    """Read it from a journal.

    Raises
    ------
    OSError
        When it can't be read.
    """
    events: list[Event] = []
    stretches: list[Stretch] = []
    begun: float | None = None
    last: tuple[str, float] | None = None
    total = 0
    for record in read_records(journal):
        event = _event_of(record, journal.parent)
        if event is None:
            continue
        at = _number((record or {}).get("at"))
        begun = at if begun is None and at else begun
        after = max(0.0, at - (begun or at)) if at else (last[1] if last else 0.0)
        total += 1
        if len(events) < MOST:
            events.append(Event(at, event[0], plain_text(event[1]), after))
        if event[0] in ("begun", "state", "end"):
            if last is not None and last[0]:
                stretches.append(Stretch(last[0], last[1], after))
            last = (
                plain_text((record or {}).get("state", "")) if event[0] == "state" else "",
                after,
            )
    if last is not None and last[0]:
        stretches.append(Stretch(last[0], last[1], last[1]))
    return TimeLine(tuple(events), tuple(stretches), total - len(events))


def _event_of(record: Record | None, folder: Path) -> tuple[str, str] | None:
    """Kind and words of a record; None for what is too small to be told."""
    if record is None:
        return "damaged", "a line of the journal can't be read"
    sort = record.get("t")
    if sort == "job":
        port = reported_port(folder, str(record.get("port", "")))
        return "begun", f"{record.get('name', '')} on {port}"
    if sort == "state":
        return "state", f"{record.get('state', '')}: {record.get('message', '')}"
    if sort == "repeated":
        return "alarm", times_words(record)
    if sort == "alarm":
        return "alarm", str(record.get("text", ""))
    if sort == "checkpoint":
        agrees = "as the job has it" if record.get("agrees") else "NOT where the job has it"
        after = f" after {record['mark']}" if record.get("mark") else ""
        return "checkpoint", f"position {agrees}, line {record.get('done', '?')}{after}"
    if sort == "looked":
        why = f", {record['why']}" if record.get("why") else ""
        words = str(record.get("decision", "")).replace("_", " ")
        return "look", f"look {record.get('look', '?')}: {words} ({record.get('by', '')}{why})"
    if sort == "insert":
        lines = len(record.get("lines", ()))
        why = f": {record['why']}" if record.get("why") else ""
        return "insert", f"{lines} lines inserted after line {record.get('after', '?')}{why}"
    if sort == "reload":
        return "reload", f"change of syringe after line {record.get('done', '?')}"
    if sort == "syringe":
        fields = {k: v for k, v in record.items() if k not in ("t", "at", "n", "command")}
        return "syringe", "new syringe: " + ", ".join(f"{k} {v}" for k, v in fields.items() if v)
    if sort == "action":
        by = f"by {record.get('who', '')}, {record.get('from', '')}"
        return "action", f"{str(record.get('do', '')).replace('_', ' ')} {by}"
    if sort == "end":
        return "end", f"{record.get('state', '')}: {record.get('message', '')}"
    return None


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
