"""Find a print's process by its folder: connect to it if alive, else read the print's outcome."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from dataclasses import replace
from pathlib import Path
from typing import Final

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.errors import JournalError, LinkError
from printctl.machine.families import link_facts
from printctl.machine.job.completed_moves import moves_ahead, surely_moved
from printctl.machine.job.job import Job
from printctl.machine.ports.locking import lock
from printctl.machine.records.record import JOURNAL, LOCK, LinkRecord, load_record
from printctl.machine.records.replay import JournalledPrint, load_printed_job, read_journal
from printctl.machine.records.states import LinkState, Status

_ANSWER_LIMIT_S: Final = 5.0
_ENDING_S: Final = 2.0
_HELD_AS: Final = {LinkState.PAUSED: "paused", LinkState.LOOKING: "held for a look"}


def read_outcome(folder: Path) -> Status:
    """Return how the print in ``folder`` ended, or what its journal says if it just broke off.

    Raises
    ------
    NoLink
        When no print was ever started there.
    """
    record = load_record(folder)
    status = _outcome(folder, record)
    if record.refused:
        tried = f"an attempt since came to nothing: {record.refused['message']}"
        status = replace(status, message=f"{status.message}; {tried}")
    return status


def _outcome(folder: Path, record: LinkRecord) -> Status:
    if record.status:
        return Status.from_dict(record.status)
    try:
        history = read_journal(folder / JOURNAL)
    except JournalError:
        history = JournalledPrint()
    counts = {
        "lines_done": history.done,
        "lines_total": history.total,
        "inserted": history.positions,
        **_places(record, history),
    }
    if history.end is not None:
        return Status.from_dict({**history.end, **counts, "alarms": len(history.alarms)})
    return Status.from_dict(
        {
            **counts,
            "state": LinkState.INTERRUPTED,
            "message": (
                f"the process that spoke to the printer ended without a word while "
                f"{history.state.value}; at least {history.done} of {history.total} lines were "
                f"acknowledged; {_still_moving(folder, record, history)}"
            ),
            "alarms": len(history.alarms),
            "position_known": False,
            "error": "LinkError",
        }
    )


def _still_moving(folder: Path, record: LinkRecord, history: JournalledPrint) -> str:
    """Say what a printer whose host is gone may go on doing, by its family."""
    if history.state in _HELD_AS:
        return f"it was {_HELD_AS[history.state]}, so its motors stood; heaters stay on"
    if not history.begun:
        return "the job had not begun, so its motors stood"
    moves = "it goes on with what it has taken"
    with contextlib.suppress(ProfileError):
        moves += f": {_held(load(Printer, record.profile))}"
    last = time.localtime(history.heard or (folder / JOURNAL).stat().st_mtime)
    return (
        f"nothing has stopped its motors: {moves} (last word on "
        f"{time.strftime('%Y-%m-%d at %H:%M:%S', last)}); heaters stay on. `printctl "
        "kill`, its own stop or its power ends both"
    )


def _held(printer: Printer) -> str:
    """Say how much a printer makes of its own accord."""
    if link_facts(printer).plans_by_time:
        return "some seconds of moves, longer where the last ones are long"
    return f"up to {moves_ahead(printer):.0f} moves"


def _places(record: LinkRecord, history: JournalledPrint) -> dict[str, int]:
    """Line of the file, and lines surely made; nothing where the file has changed or is gone."""
    try:
        printer = load(Printer, record.profile)
        job = load_printed_job(Path(record.job), printer, history)
    except (LinkError, ProfileError):
        return {}
    if job.sha256 != history.job.get("sha256"):
        return {}
    return {
        "file_line": job.file_line(history.done),
        "lines_executed": _made(job, history, printer),
    }


def _made(job: Job, history: JournalledPrint, printer: Printer) -> int:
    """Lines surely made; at an end that dropped moves, those before the place where it stood."""
    sure = max(surely_moved(job.lines, history.done, moves_ahead(printer)), history.made)
    if history.end is None or not history.end.get("position_known"):
        return sure
    if history.stood is not None:
        return int(history.stood["line"]) if history.stood["certain"] else sure
    dropped = history.state is not LinkState.DONE and bool(link_facts(printer).quickstop)
    return sure if dropped else history.done


def stays_alive(folder: Path, held: str = LOCK) -> bool:
    """Whether a link process is at work; one that is just ending is given the time to."""
    limit = time.monotonic() + _ENDING_S
    while alive(folder, held):
        if time.monotonic() > limit:
            return True
        time.sleep(0.02)
    return False


def alive(folder: Path, held: str = LOCK) -> bool:
    """Whether a link process holds the folder's lock, which is the file ``held``."""
    try:
        with (folder / held).open("a+b") as handle:
            lock(handle, shared=True)
    except FileNotFoundError:  # no folder, so nobody works in it
        return False
    except OSError:
        return True
    return False


def connect(record: LinkRecord) -> socket.socket | None:
    """Connect to a link process; None when nobody listens there any more."""
    return None if record.status else open_address(record.address)


def open_address(address: str) -> socket.socket | None:
    """Connect to an address given by `command_socket.listen`; None when it is dead."""
    kind, _, rest = address.partition(":")
    if not kind:
        return None
    if kind == "tcp":
        host, _, port = rest.rpartition(":")
        try:
            return _endless(socket.create_connection((host, int(port)), _ANSWER_LIMIT_S))
        except OSError:
            return None
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(_ANSWER_LIMIT_S)
    try:
        connection.connect(rest)
    except OSError:
        connection.close()
        return None
    return _endless(connection)


def _endless(connection: socket.socket) -> socket.socket:
    connection.settimeout(None)
    return connection


def has_ended(pid: int) -> bool:
    """Whether a process has ended, as far as that can be told."""
    if os.name != "posix":
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False
