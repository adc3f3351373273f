"""Summary of one past print, read from its journal: user, job, time, outcome, alarms."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from printctl.machine.records.folders import plain_text, read_notes
from printctl.machine.records.journal import read_records
from printctl.machine.records.record import reported_port
from printctl.machine.records.replay import replay
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
        As the print's record names them (`read_notes`); empty without one.
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


def entry_of(journal: Path) -> PrintEntry | None:
    """Read a journal from its first job record on; None where there is none that can be read.

    Raises
    ------
    OSError
        When the file can't be read.
    """
    known = replay(read_records(journal))
    first, end = known.first_job, (known.end or {}) if known.over else {}
    if not first:
        return None
    try:
        alarms = zip(known.alarm_times, map(plain_text, known.alarms), strict=True)
        return PrintEntry(
            id=known.print_id,
            journal=journal,
            started=known.started,
            ended=float(end.get("at", 0.0)),
            state=plain_text(end.get("state", INTERRUPTED)),
            message=plain_text(end.get("message", known.message)),
            error=plain_text(end.get("error", "")),
            done=known.done,
            total=known.total,
            begun=known.attempts,
            alarms=tuple(Alarm(at, text) for at, text in alarms),
            operator=_operator(journal),
            file=plain_text(first.get("name", "")),
            port=reported_port(journal.parent, plain_text(first.get("port", ""))),
            **{
                k: plain_text(first.get(k, ""))
                for k in ("who", "host", "path", "sha256", "profile")
            },
        )
    except (TypeError, ValueError, OverflowError):  # written by something else
        return None


def _operator(journal: Path) -> str:
    """Who is named in the print's record."""
    values = read_notes(journal).get("values")
    return plain_text(values.get("operator") or "") if isinstance(values, dict) else ""
