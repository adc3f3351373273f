"""History entry of one print, read from its journal: user, job, time, outcome, alarms."""

from __future__ import annotations

import getpass
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from printctl.machine.records.journal import Record, print_id, read_records
from printctl.machine.records.journalled_print import replay, times_words
from printctl.machine.records.print_notes import read_notes
from printctl.machine.records.record import reported_port
from printctl.machine.records.states import LinkState

INTERRUPTED = LinkState.INTERRUPTED.value
"""State of a print whose journal has no end: its link process died, or it is going on."""


@dataclass(frozen=True)
class Alarm:
    """One alarm of a print.

    Attributes
    ----------
    at : float
        Wall-clock time, s since 1970; 0 where the journal doesn't say.
    text : str
    """

    at: float
    text: str


@dataclass(frozen=True)
class PrintEntry:
    """One print.

    Attributes
    ----------
    id : str
        The same as long as the journal's first record is, whatever the file is called by now.
    journal : Path
    who, host : str
    file, path, sha256 : str
        Name, place and hash of the job file.
    profile, port : str
    started, ended : float
        Wall-clock time, s since 1970; 0 for unknown or not yet.
    state, message, error : str
        How it ended; `INTERRUPTED` without an end.
    done, total : int
        Command lines.
    begun : int
        How often it was begun or gone on with.
    alarms : tuple of Alarm
    operator : str
        As the print's record names them (`print_notes`); empty without one.
    """

    id: str
    journal: Path
    who: str = ""
    host: str = ""
    file: str = ""
    path: str = ""
    sha256: str = ""
    profile: str = ""
    port: str = ""
    started: float = 0.0
    ended: float = 0.0
    state: str = INTERRUPTED
    message: str = ""
    error: str = ""
    done: int = 0
    total: int = 0
    begun: int = 0
    alarms: tuple[Alarm, ...] = ()
    operator: str = ""

    @property
    def by(self) -> str:
        """Who printed: the operator, else the computer's user."""
        return self.operator or self.who


def this_user() -> dict[str, str]:
    """Who prints here, for the journal's job record."""
    try:
        who = getpass.getuser()
    except (OSError, KeyError, ImportError):  # a container's user may have no name
        who = ""
    return {"who": who, "host": platform.node()}


def entry_of(journal: Path) -> PrintEntry | None:
    """Read a journal from its first job record on; None where there is none.

    Raises
    ------
    OSError
        When the file can't be read.
    """
    records = [record for record in read_records(journal) if record is not None]
    jobs = [record for record in records if record.get("t") == "job"]
    if not jobs:
        return None
    end: Record = {}
    for record in records:
        if record.get("t") == "end":
            end = record
        elif record.get("t") == "job":
            end = {}
    first, known = jobs[0], replay(records)
    return PrintEntry(
        id=print_id(first),
        journal=journal,
        started=float(first.get("started", 0.0)),
        ended=float(end.get("at", 0.0)),
        state=plain_text(end.get("state", INTERRUPTED)),
        message=plain_text(end.get("message", known.message)),
        error=plain_text(end.get("error", "")),
        done=known.done,
        total=known.total,
        begun=len(jobs),
        alarms=_alarms(records),
        operator=_operator(journal),
        file=plain_text(first.get("name", "")),
        port=reported_port(journal.parent, plain_text(first.get("port", ""))),
        **{k: plain_text(first.get(k, "")) for k in ("who", "host", "path", "sha256", "profile")},
    )


def _alarms(records: Sequence[Record]) -> tuple[Alarm, ...]:
    """Return each alarm once, when it came first; of one that came again how often."""
    alarms: list[Alarm] = []
    first: dict[object, int] = {}
    for record in records:
        if record.get("t") == "alarm":
            first[record.get("text")] = len(alarms)
            at = float(record.get("at", 0.0))
            alarms.append(Alarm(at, plain_text(record.get("text", ""))))
        elif record.get("t") == "repeated" and record.get("first") in first:
            index = first[record.get("first")]
            alarms[index] = Alarm(alarms[index].at, plain_text(times_words(record)))
    return tuple(alarms)


def plain_text(value: object) -> str:
    """A value as text that can be written anywhere; file names may hold other bytes than UTF-8."""
    return str(value).encode("utf-8", "replace").decode("utf-8")


def _operator(journal: Path) -> str:
    """Who is named in the print's record."""
    values = read_notes(journal).get("values")
    return plain_text(values.get("operator") or "") if isinstance(values, dict) else ""
