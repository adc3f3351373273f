"""Read how a print whose process has gone ended, and whether it can be gone on with."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from pathlib import Path
from typing import Final

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.errors import JournalError, LinkError, Refused
from printctl.machine.families import link_facts
from printctl.machine.job.job import Job
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.ports.detection import runs_files
from printctl.machine.records.printed_job import load_printed_job
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.replay import JournalledPrint, read_journal
from printctl.machine.records.states import LinkState, Status, state_words

_HELD_AS: Final = {LinkState.PAUSED: "paused", LinkState.LOOKING: "held for a look"}


def read_outcome(folder: Path) -> Status:
    """Return how the print in ``folder`` ended, or what its journal says if it just broke off.

    NoLink when no print was ever started there.
    """
    record = load_record(folder)
    status = _outcome(folder, record)
    if record.refused:
        tried = f"an attempt since came to nothing: {record.refused['message']}"
        status = replace(status, message=f"{status.message}; {tried}")
    return status


def _outcome(folder: Path, record: ContactRecord) -> Status:
    if record.status:
        return Status.from_dict(record.status)
    history, unread = JournalledPrint(), ""
    try:
        history = read_journal(folder / JOURNAL)
    except JournalError as exc:
        # without an address the process died before it wrote a journal
        unread = str(exc) if record.address or (folder / JOURNAL).exists() else ""
    if history.damaged and not history.begun:
        unread = f"journal {folder / JOURNAL} is damaged"
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
                "the process that controlled the printer ended unexpectedly"
                f"{_unknown(unread) if unread else _last_known(folder, record, history)}"
            ),
            "alarms": len(history.alarms),
            "position_known": False,
            "error": "LinkError",
        }
    )


def _unknown(why: str) -> str:
    return (
        f", and its progress is unknown: {why}; motors may be moving and heaters on. `printctl "
        "emergency-stop`, its own emergency switch or its power ends both"
    )


def _last_known(folder: Path, record: ContactRecord, history: JournalledPrint) -> str:
    return (
        f" while {state_words(history.state)}; at least {history.done} of {history.total} "
        f"lines were acknowledged; {_still_moving(folder, record, history)}"
    )


def _still_moving(folder: Path, record: ContactRecord, history: JournalledPrint) -> str:
    """Say what a printer whose host is gone may go on doing, by its family."""
    if runs_files(record.port):
        return (
            f"{record.port} continues the file by itself, if it was started; `printctl resume` "
            "follows it again without starting anything twice, then `printctl cancel` ends it in "
            "the host's way; `printctl emergency-stop` halts it"
        )
    if history.stopping:
        return _was_stopping(record, history)
    if history.state in _HELD_AS:
        return f"it was {_HELD_AS[history.state]}, so its motors were at rest; heaters stay as set"
    if not history.begun:
        return "the job had not started, so its motors were at rest"
    moves, air = "it executes its queued moves", ""
    with contextlib.suppress(ProfileError):
        printer = load(Printer, record.profile)
        moves += f": {_held(printer)}"
        air = "; a valve may be open: release the air pressure" if printer.airs else ""
    last = time.localtime(history.heard or (folder / JOURNAL).stat().st_mtime)
    return (
        f"nothing has stopped its motors: {moves} (last message on "
        f"{time.strftime('%Y-%m-%d at %H:%M:%S', last)}); heaters stay as set{air}. `printctl "
        "emergency-stop`, its own emergency switch or its power ends both"
    )


def _was_stopping(record: ContactRecord, history: JournalledPrint) -> str:
    """Say what is known where the process died on the way out: not how far it came."""
    motors = "its motors execute the queued moves"
    with contextlib.suppress(ProfileError):
        if quickstop := link_facts(load(Printer, record.profile)).quickstop:
            motors = f"its motors were told to stop ({quickstop.decode()})"
    return (
        f"it was being ended ({history.message}): {motors}; its needle may be up or still down, "
        "and heaters may be on. `printctl emergency-stop`, its own emergency switch or its power "
        "ends it"
    )


def _held(printer: Printer) -> str:
    """Say how much a printer makes of its own accord."""
    if link_facts(printer).plans_by_time:
        return "some seconds of moves, longer where the last ones are long"
    return f"up to {moves_ahead(printer):.0f} moves"


def _places(record: ContactRecord, history: JournalledPrint) -> dict[str, int]:
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


def may_still_move(status: Status) -> bool:
    """Whether a print has ended so that its printer may go on with what it has taken."""
    halted = status.state is LinkState.KILLED and UNCONFIRMED not in status.message
    return status.ended and not status.position_known and not halted


def resumable(folder: Path, sha256: str | None = None) -> JournalledPrint:
    """Read the journal of a print that was interrupted, of a job file with this hash if given.

    Interrupted is a print whose link process died, whose port went away, or whose printer fell
    silent. The printer itself is asked later.

    Raises
    ------
    Refused
        When the print has ended in another way, was being ended, was never begun, or was of
        another file, or when records are missing in its journal.
    JournalError
        When there is no journal.
    """
    history = read_journal(folder / JOURNAL)
    end = history.end
    if end is not None and (end["position_known"] or history.state is not LinkState.FAILED):
        raise Refused(
            f"the print in {folder} has ended ({state_words(history.state)}: {history.message}); "
            f"it can't be continued: {_remedy(history)}"
        )
    if history.stopping:
        raise Refused(
            f"the print in {folder} was being ended ({history.message}): its heaters may be off "
            "and its needle up; print it anew"
        )
    if history.cut_short:
        raise Refused(
            f"the disk was full, and how the print in {folder} went on isn't in its journal: its "
            "needle may be up and its heaters off; look at the part and use `printctl recover`"
        )
    if history.gaps:
        raise Refused(
            f"the journal in {folder} is damaged in {history.gaps} places, so that its lines can't "
            "be counted; see `printctl recover`, and to the disk"
        )
    if not history.begun:
        raise Refused(f"no line of the job was sent in {folder}; print it anew")
    if sha256 is not None and history.job.get("sha256") != sha256:
        raise Refused(other_file_words(folder, history))
    return history


def other_file_words(folder: Path, history: JournalledPrint) -> str:
    """Say that a print can't be gone on with by a file that isn't its own, and the way out."""
    name, sha256 = history.job.get("name"), str(history.job.get("sha256", ""))
    return (
        f"the print in {folder} was of another file, or {name} has changed since (its SHA-256 "
        f"began with {sha256[:12]}): what was printed lies where the needle would write. Restore "
        f"that file at {history.job.get('path')}, then `printctl resume {folder}`; without it, "
        f"`printctl give-up {folder}`, clear the dish and print anew"
    )


def followable(folder: Path, sha256: str | None = None) -> JournalledPrint:
    """Read the journal of a network host's print whose end isn't known, to follow it again.

    Raises
    ------
    Refused
        When its end is known, or it was of another file.
    JournalError
        When there is no journal.
    """
    history = read_journal(folder / JOURNAL)
    if history.end is not None and history.state is not LinkState.POSITION_UNKNOWN:
        raise Refused(
            f"the print in {folder} has ended "
            f"({state_words(history.state)}: {history.message}); print it again"
        )
    if not history.job:
        raise Refused(f"the journal in {folder} doesn't say which print it is of; print it anew")
    if sha256 is not None and history.sha256 != sha256:
        raise Refused(other_file_words(folder, history))
    return history


def _remedy(history: JournalledPrint) -> str:
    """What is left to do with a print that has ended."""
    whole = history.state is LinkState.DONE
    return "print it anew" if whole else "`printctl recover` writes its rest, or print it anew"
