"""True state of a print, by its journal and link process, and the actions that it allows."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from firmware_profiles import Printer, ProfileError, Syringe, load
from printctl.errors import PrintctlError, UsageError
from printctl.machine.errors import LinkError, NoLink, Refused
from printctl.machine.families import link_facts
from printctl.machine.job.care import Care
from printctl.machine.job.job import file_count, load_job
from printctl.machine.job.syringes import Filling
from printctl.machine.ports.detection import SIMULATED, runs_files
from printctl.machine.prints.alerts import Alert, alert_of
from printctl.machine.prints.progress import JobTable, Progress, Supply, progress
from printctl.machine.prints.recovery import NoCheckpoint
from printctl.machine.prints.recovery_file import planned
from printctl.machine.prints.words import print_words, progress_words, tip_words
from printctl.machine.process.clients.client import PrintClient, attach
from printctl.machine.process.contact import (
    STATION_LOCK,
    STATION_RECORD,
    alive,
    last_status,
    load_station,
)
from printctl.machine.process.outcome import followable, resumable
from printctl.machine.records.folders import data_folder, known_folders
from printctl.machine.records.record import (
    JOURNAL,
    LOCK,
    RECORD,
    SIM_ADDRESS,
    load_record,
    reported_port,
)
from printctl.machine.records.replay import JournalledPrint, read_journal_if_any
from printctl.machine.records.states import LinkState, Status, state_words

TABLE = "progress.{}.npz"
"""A print's table, with the beginning of its job's hash."""


def print_folder(run: Path) -> Path:
    """Folder of the print's journal; where one should be when none is found."""
    beside = Path(f"{run}.print") if run.is_file() else run
    folders = (place for place in (run, run / "print", beside) if (place / RECORD).is_file())
    return next(folders, beside)


def run_going_on(run: Path | None) -> Path:
    """Return ``run``; the folder of the only print of this user that is going on where it is None.

    Raises
    ------
    UsageError
        When none is going on, or more than one.
    """
    if run is not None:
        return run
    folders = [one for one in known_folders(data_folder()) if (one / RECORD).is_file()]
    going_on = [one for one in folders if (one / LOCK).exists() and alive(one)]
    if len(going_on) == 1:
        return going_on[0]
    if not going_on:
        raise UsageError("no print of yours is going on; name the RUN that is meant")
    names = ", ".join(map(str, going_on))
    raise UsageError(f"{len(going_on)} prints are going on ({names}); name the RUN that is meant")


def running_print(run: Path) -> PrintClient:
    """Return a client of a print that is going on.

    Raises `PrintctlError` when it has ended, `LinkError` when none was ever started there.
    """
    client = attach(print_folder(run))
    status = client.status
    if status.ended:
        still = status.position_known or status.state is LinkState.KILLED
        halts = "" if still else "; if anything moves, `printctl emergency-stop` halts it"
        if not _why_no_going_on(client.folder):
            halts = f"; `printctl resume {run}` takes it up again, then give this command{halts}"
        raise PrintctlError(
            f"the print in {client.folder} has ended "
            f"({state_words(status.state)}: {status.message}){halts}"
        )
    return client


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
    reason : str
        Why it can't be done, or why something is needed; empty for neither.
    needs : str
        What must be given with it: ``syringe`` (what was put in), ``from_line`` (where to begin).
    from_line : int
        Line of the file with which the rest begins by default; 0 where the journal doesn't tell.
    """

    action: PrintAction
    possible: bool = True
    reason: str = ""
    needs: Literal["", "syringe", "from_line"] = ""
    from_line: int = 0

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


@dataclass(frozen=True)
class PrintTruth:
    """True state of a print.

    ``status`` is the link process's while it lives, else what it left. ``progress`` is None until
    the job's table was made (the page does, and `printctl print`'s checks don't). ``actions`` are
    all, possible or not.
    """

    folder: Path
    status: Status
    journal: JournalledPrint = field(default_factory=JournalledPrint)
    progress: Progress | None = None
    actions: tuple[Possible, ...] = ()

    @property
    def share(self) -> float:
        """How much of the print is made, 0 to 1: of its time where that is known, else of lines."""
        if self.progress is not None:
            return self.progress.share
        return self.status.lines_executed / max(self.status.lines_total, 1)

    @property
    def time_left_s(self) -> float | None:
        """Time left, s; None for a print that is over, or whose time isn't known."""
        if self.status.ended or self.progress is None:
            return None
        return self.progress.remaining_s

    @property
    def words(self) -> dict[str, str]:
        """State, what is made, time, layer, vessel, ink and tip as a person is told them."""
        made = progress_words(self.status, self.progress)
        state = f"{state_words(self.status.state).capitalize()} · {made.removesuffix(' made')}"
        tip = tip_words(self.status, self.progress, self.journal.stood_mm)
        return {"state": state, "made": made, "tip": tip, **print_words(self.status, self.progress)}

    @property
    def alert(self) -> Alert | None:
        """What somebody must know: an end that wasn't as meant, else the last alarm."""
        if not (self.status.ended or self.status.alarms):
            return None
        go_on = any(one.action is PrintAction.GO_ON and one.possible for one in self.actions)
        return alert_of(self.status, self.journal.last_alarm, go_on)

    def may(self, action: PrintAction) -> Possible:
        """Whether an action can be done now."""
        return next(one for one in self.actions if one.action is action)

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object: the same for page, API and command line."""
        return {
            **self.status.to_dict(),
            "folder": str(self.folder),
            "print_id": self.journal.print_id,
            "started": self.journal.started,
            "ended": self.status.ended,
            "last_alarm": self.journal.last_alarm,
            "alert": None if self.alert is None else asdict(self.alert),
            "share": self.share,
            "words": self.words,
            "time_left_s": self.time_left_s,
            "progress": None if self.progress is None else self.progress.to_dict(),
            "actions": [one.to_dict() for one in self.actions],
        }


def read_print(folder: Path) -> PrintTruth:
    """Read the true state of the print in ``folder``; ask its link process if that lives.

    Raises `NoLink` when no print was ever started there, or its link process doesn't answer.
    """
    with attach(folder) as client:
        status = client.status
    journal = read_journal_if_any(folder / JOURNAL)
    table = kept_table(folder, journal.sha256)
    supply = None if table is None else supply_of(folder)
    return assemble_state(folder, status, journal, table, supply)


def assemble_state(
    folder: Path,
    status: Status,
    journal: JournalledPrint,
    table: JobTable | None = None,
    supply: Supply | None = None,
) -> PrintTruth:
    """Put a print's state together from what was read of it; a table of another file is left."""
    actions = possible_actions(folder, status)
    if status.state is LinkState.INTERRUPTED:
        status = replace(status, message=f"{status.message}; {_next_step(actions)}")
    own = file_count(status.lines_total, status.inserted)  # a table is of the file's commands
    if table is None or len(table) != own:
        return PrintTruth(folder, status, journal, None, actions)
    made = progress(table, status, journal, time.time(), supply)
    return PrintTruth(folder, status, journal, made, actions)


def _next_step(actions: tuple[Possible, ...]) -> str:
    """Say what can be done after an interruption; promise nothing that would be refused."""
    can = {one.action: one for one in actions}
    if can[PrintAction.GO_ON].possible:
        return (
            "if the printer kept its power, Go on (`printctl resume`) asks it for its last line "
            "and goes on from there"
        )
    ways = f"it can't be gone on with: {can[PrintAction.GO_ON].reason}"
    if can[PrintAction.RECOVER].possible and "recover" not in ways.lower():
        ways += "; Recover (`printctl recover`) plans the rest as a job of its own"
    return ways


def supply_of(folder: Path) -> Supply | None:
    """Return the syringe with which a print began; None where unknown, as of several heads."""
    care = Care.from_dict(load_record(folder).care)
    if care.head_capacity_mm or not care.syringe or not care.capacity_mm:
        return None
    with contextlib.suppress(Exception):  # a profile that is gone: the ink left isn't shown
        bore_mm = load(Syringe, care.syringe).inner_mm
        return Supply(Filling(0, care.used_mm, care.capacity_mm), math.pi / 4 * bore_mm**2)
    return None


def kept_table(folder: Path, sha256: str) -> JobTable | None:
    """Return the table of the file that is printed in ``folder``, where one was made."""
    path = folder / TABLE.format(sha256[:16])
    if not path.is_file():
        return None
    try:
        return JobTable.load(path)
    except (OSError, ValueError, KeyError):
        return None


def keep_table(folder: Path, sha256: str, table: JobTable) -> None:
    """Leave a print's table beside its journal for other readers; a full disk may refuse."""
    path = folder / TABLE.format(sha256[:16])
    if sha256 and not path.exists():
        with contextlib.suppress(OSError):
            table.save(path)


def possible_actions(folder: Path, status: Status) -> tuple[Possible, ...]:
    """Return every action, in the order of `PrintAction`, as the print in ``folder`` stands."""
    if status.ended:
        return (*_of_ended(status), *_after_the_end(folder, status.state, _changed(folder)))
    goes_on = f"the print goes on ({state_words(status.state)})"
    after = (PrintAction.GO_ON, PrintAction.RECOVER, PrintAction.GIVE_UP)
    return (*_while_going_on(status), *(_unless(goes_on, action) for action in after))


def _unless(
    why_not: str, action: PrintAction, needs: Literal["", "syringe", "from_line"] = ""
) -> Possible:
    return Possible(action, not why_not, why_not, needs)


def _of_ended(status: Status) -> Iterator[Possible]:
    over = f"the print is over ({state_words(status.state)})"
    for action in (PrintAction.PAUSE, PrintAction.RESUME, PrintAction.STOP):
        yield _unless(over, action)
    yield _unless(f"{over}; EMERGENCY STOP halts whatever is connected", PrintAction.KILL)


def _while_going_on(status: Status) -> Iterator[Possible]:
    state, words = status.state, state_words(status.state)
    held = state in (LinkState.PAUSED, LinkState.LOOKING)
    going = state in (LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING)
    may_pause = going or state is LinkState.LOOKING
    yield _unless("" if may_pause else f"the print is {words}", PrintAction.PAUSE)
    may_resume = held or (going and bool(status.waits_for))
    changing = held and status.waits_for.startswith("syringe")
    why_not = "" if may_resume else f"the print isn't paused, it is {words}"
    yield _unless(why_not, PrintAction.RESUME, "syringe" if changing else "")
    why_not = "the print is being cancelled" if state is LinkState.STOPPING else ""
    yield _unless(why_not, PrintAction.STOP)
    yield Possible(PrintAction.KILL)


@lru_cache(maxsize=32)
def _after_the_end(
    folder: Path, state: LinkState, changed: tuple[tuple[str, int], ...]
) -> tuple[Possible, ...]:
    """Read journal and job once for each change of them."""
    why_not = _why_no_going_on(folder)
    unfinished = state is LinkState.INTERRUPTED or not why_not
    written = f"how the print ended is written down already: {state_words(state)}"
    return (
        _unless(why_not, PrintAction.GO_ON),
        _recover(folder),
        _unless("" if unfinished else written, PrintAction.GIVE_UP),
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
        if runs_files(record.port):
            followable(folder, load_job(Path(record.job), printer).sha256)
            return ""
        resumable(folder, load_job(Path(record.job), printer).sha256)
        refuse_forgotten(folder, record.port, printer)
    except (LinkError, ProfileError) as exc:
        return str(exc)
    return ""


def refuse_forgotten(folder: Path, port: str, printer: Printer) -> None:
    """Raise `Refused` where the printer certainly doesn't know its place in the job any more."""
    if reported_port(folder, port) == SIMULATED and not alive(folder, SIM_ADDRESS):
        raise Refused(
            "the simulated printer has ended, too: it waits 15 min for someone to go on; print "
            "the job anew"
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
