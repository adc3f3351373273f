"""Actions allowed on a print in its present state, and reasons against the others."""

from __future__ import annotations

import contextlib
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from firmware_profiles import Printer, ProfileError, load
from printctl.errors import PrintctlError
from printctl.machine.errors import LinkError, NoLink, Refused
from printctl.machine.families import link_facts
from printctl.machine.job.job import load_job
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.prints.print_words import state_words
from printctl.machine.prints.recovery import NoCheckpoint
from printctl.machine.prints.recovery_file import planned
from printctl.machine.process.contact import (
    STATION_LOCK,
    STATION_RECORD,
    alive,
    last_status,
    load_station,
)
from printctl.machine.process.outcome import resumable
from printctl.machine.records.history import data_folder
from printctl.machine.records.record import JOURNAL, RECORD, load_record
from printctl.machine.records.states import LinkState, Status


class PrintAction(StrEnum):
    """What a person can ask for."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    KILL = "kill"
    GO_ON = "go_on"
    RECOVER = "recover"
    GIVE_UP = "give_up"


@dataclass(frozen=True)
class Possible:
    """One action, and whether it can be done now.

    Attributes
    ----------
    action : PrintAction
    possible : bool
    reason : str
        Why it can't be done; empty where it can.
    needs : str
        What must be given with it: ``syringe`` (what was put in), ``from_line`` (where to begin);
        empty for nothing.
    from_line : int
        Line of the file with which the rest begins where nobody says otherwise; 0 where the journal
        doesn't tell.
    """

    action: PrintAction
    possible: bool = True
    reason: str = ""
    needs: Literal["", "syringe", "from_line"] = ""
    from_line: int = 0

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


def possible_actions(folder: Path, status: Status) -> tuple[Possible, ...]:
    """Return every action, in the order of `PrintAction`, as the print in ``folder`` stands."""
    return (*_while_going_on(status), *_after_the_end(folder, status))


def _while_going_on(status: Status) -> tuple[Possible, ...]:
    state = status.state
    if status.ended:
        over = f"the print is over ({state_words(state)})"
        halt = f"{over}; the red STOP halts whatever is connected"
        acts = (PrintAction.PAUSE, PrintAction.RESUME, PrintAction.STOP)
        return *(Possible(act, False, over) for act in acts), Possible(
            PrintAction.KILL, False, halt
        )
    held = state in (LinkState.PAUSED, LinkState.LOOKING)
    going = state in (LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING)
    changing = held and status.waits_for.startswith("syringe")
    resume = held or (going and bool(status.waits_for))
    stopping = state is LinkState.STOPPING
    may_pause = going or state is LinkState.LOOKING
    why_not = f"the print is {state_words(state)}"
    return (
        Possible(PrintAction.PAUSE, may_pause, "" if may_pause else why_not),
        Possible(
            PrintAction.RESUME,
            resume,
            "" if resume else f"the print isn't paused, it is {state_words(state)}",
            "syringe" if changing else "",
        ),
        Possible(PrintAction.STOP, not stopping, "the print is being stopped" if stopping else ""),
        Possible(PrintAction.KILL),
    )


def _after_the_end(folder: Path, status: Status) -> tuple[Possible, ...]:
    if not status.ended:
        reason = f"the print goes on ({state_words(status.state)})"
        return tuple(
            Possible(action, False, reason)
            for action in (PrintAction.GO_ON, PrintAction.RECOVER, PrintAction.GIVE_UP)
        )
    return _looked_up(folder, status.state, _changed(folder))


@lru_cache(maxsize=32)
def _looked_up(
    folder: Path, state: LinkState, changed: tuple[tuple[str, int], ...]
) -> tuple[Possible, ...]:
    """Read journal and job once for each change of them."""
    why_not = _why_no_going_on(folder)
    unfinished = state is LinkState.INTERRUPTED or not why_not
    return (
        Possible(PrintAction.GO_ON, not why_not, why_not),
        _recover(folder),
        Possible(
            PrintAction.GIVE_UP,
            unfinished,
            ""
            if unfinished
            else f"how the print ended is written down already: {state_words(state)}",
        ),
    )


def _changed(folder: Path) -> tuple[tuple[str, int], ...]:
    """All that an answer rests on: files with the time of their last change, ns; live stations."""
    near = stations(folder)
    files = [folder / RECORD, folder / JOURNAL, *(station / STATION_RECORD for station in near)]
    with contextlib.suppress(LinkError):
        files.append(Path(load_record(folder).job))
    times = [(str(path), path.stat().st_mtime_ns) for path in files if path.exists()]
    return *times, *((str(station), int(alive(station, STATION_LOCK))) for station in near)


def _why_no_going_on(folder: Path) -> str:
    """Why `printctl.observe.continue_print.go_on` would refuse; empty where it wouldn't."""
    try:
        record = load_record(folder)
        printer = load(Printer, record.profile)
        resumable(folder, load_job(Path(record.job), printer).sha256)
        refuse_forgotten(folder, record.port, printer)
    except (LinkError, ProfileError) as exc:
        return str(exc)
    return ""


def refuse_forgotten(folder: Path, port: str, printer: Printer) -> None:
    """Refuse to go on where the printer certainly doesn't know its place in the job any more.

    Raises
    ------
    Refused
    """
    if port == SIMULATED:
        raise Refused(
            "the simulated printer ended with the process that ran it; print the job anew"
        )
    if not link_facts(printer).remembers:
        raise Refused(
            f"a printer with {printer.firmware} can't tell which line it took last, so the print "
            "can't be gone on with; see Recover (`printctl recover`)"
        )
    for station in stations(folder):
        try:
            last = last_status(load_station(station))
        except NoLink:  # nothing that can be read: the port itself will tell
            continue
        if last.open and last.port == port and alive(station, STATION_LOCK):
            raise Refused(
                f"the printer on {port} was connected anew after this print, which numbers "
                "its lines anew; see Recover (`printctl recover`)"
            )


def stations(folder: Path) -> list[Path]:
    """Return the folders of stations that may print into a folder: its workspace's, the user's."""
    near = [*folder.resolve().parents[:3], data_folder()]
    return [place / "station" for place in near if (place / "station" / STATION_RECORD).is_file()]


def _recover(folder: Path) -> Possible:
    try:
        planned(folder)
    except NoCheckpoint as exc:
        return Possible(PrintAction.RECOVER, True, str(exc), "from_line", exc.line)
    except (PrintctlError, LinkError, ProfileError, OSError) as exc:
        return Possible(PrintAction.RECOVER, False, str(exc))
    return Possible(PrintAction.RECOVER)
