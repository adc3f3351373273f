"""Find machine processes: their contact files, the locks that say whether they live."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from printctl.machine.control.idle.station_status import StationState, StationStatus
from printctl.machine.errors import AlreadyPrinting, PortInUse, Refused
from printctl.machine.ports.locking import lock
from printctl.machine.records.folders import data_folder
from printctl.machine.records.journal import read_records
from printctl.machine.records.record import LOCK, RECORD, ContactRecord, read_contact

STATION_RECORD: Final = "station.json"
STATION_JOURNAL: Final = "station.journal"
STATION_LOG: Final = "station.log"
STATION_LOCK: Final = "station.lock"
STATION_SOCKET: Final = "station.sock"
_DOWN: Final = frozenset({StationState.HALTED, StationState.LOST, StationState.CLOSED})
_ENDING_S: Final = 2.0
_LOCK_PATIENCE_S: Final = 0.3

log = logging.getLogger(__name__)


@contextmanager
def hold_folder(folder: Path, held: str = LOCK, what: str = "a print is running") -> Iterator[None]:
    """Hold the folder's lock (the file ``held``), which the system frees when the process dies."""
    with (folder / held).open("a+b") as handle:
        limit = time.monotonic() + _LOCK_PATIENCE_S
        while True:  # a client that looks whether anybody holds it does so for a moment
            try:
                lock(handle)
                break
            except OSError as exc:
                if time.monotonic() > limit:
                    raise AlreadyPrinting(
                        f"{what} in {folder}; attach to it, or give another folder"
                    ) from exc
                time.sleep(0.01)
        yield


def alive(folder: Path, held: str = LOCK) -> bool:
    """Whether a process holds the folder's lock, which is the file ``held``."""
    try:
        with (folder / held).open("a+b") as handle:
            lock(handle, shared=True)
    except (FileNotFoundError, NotADirectoryError):  # no folder, so nobody works in it
        return False
    except OSError:
        return True
    return False


def refuse_shared_profile(holder: str, folder: Path, port: str) -> None:
    """Raise `Refused` where another machine is at work by the same profile.

    What is mounted is kept by profile, so both would take their ink from one account. Raise
    `PortInUse` where the same machine is.

    Parameters
    ----------
    holder : str
        Folder of the profile's last station or print; empty for none.
    folder, port : Path, str
        Of the one that is to begin.
    """
    other = Path(holder)
    if not holder or other == folder.resolve():
        return
    for lock_file, record in ((STATION_LOCK, STATION_RECORD), (LOCK, RECORD)):
        if not alive(other, lock_file):
            continue
        there = read_contact(other / record, "").port
        if there != port:
            raise Refused(
                f"the printer at {there} is at work by the same profile ({other}), and what is "
                f"mounted is kept by profile; give the one at {port} a copy of the profile (one "
                ".yaml file for each machine), or wait for the other's end"
            )
        if stays_alive(other, lock_file):
            look = f"status {other}" if lock_file == LOCK else f"station status --folder {other}"
            raise PortInUse(
                f"port {port} is held by printctl itself, which is at work in {other}: `printctl "
                f"{look}` tells what it does; wait for its end, or end it first"
            )


def stays_alive(folder: Path, held: str = LOCK) -> bool:
    """Whether a process is at work; one that is just ending is given the time to."""
    limit = time.monotonic() + _ENDING_S
    while alive(folder, held):
        if time.monotonic() > limit:
            return True
        time.sleep(0.02)
    return False


def last_status(record: ContactRecord) -> StationStatus:
    """Return the status in a station's record."""
    if not record.status:
        return StationStatus(StationState.CONNECTING, profile=record.profile, port=record.port)
    return StationStatus.from_dict(record.status)


def load_station(folder: Path) -> ContactRecord:
    """Read a station's record; NoLink where none was ever opened, or it can't be read."""
    absent = f"no printer was ever connected in {folder} (no {STATION_RECORD} there); connect first"
    return read_contact(folder / STATION_RECORD, absent)


def save_station(record: ContactRecord, folder: Path) -> None:
    """Write a station's record; on a full disk the older one stays, its journal says the rest."""
    try:
        record.save(folder, STATION_RECORD)
    except OSError:  # a full disk mustn't end a station that holds a needle in a gel
        log.exception("%s can't be written", STATION_RECORD)


def last_word(folder: Path) -> StationStatus:
    """Return how a station that has gone stood last, as closed or lost; its place is unknown."""
    record = load_station(folder)
    last = last_status(record)
    if last.state in (StationState.CLOSED, StationState.LOST):
        return last
    state: StationState = last.state
    message, error = "", "LinkError"
    for kept in records_since(folder / STATION_JOURNAL, "state", record.started):
        state, message = StationState(kept["state"]), str(kept.get("message"))
    if state not in _DOWN:
        state, message = last.state, ""
    if state is StationState.CLOSED:  # the disk was full, and its record couldn't be written
        error = last.error
    else:
        message = f"the station ended without a word while {state.value}; {_remedy(state, last)}"
        state = StationState.LOST
    return without_place(replace(last, state=state, message=message, error=error))


def _remedy(state: StationState, last: StationStatus) -> str:
    """Return what to do about a station that ended without a word in a state."""
    if state is StationState.PRINTING and last.print_folder:
        return (
            f"if its print isn't over, `printctl resume {last.print_folder}` goes on with it, and "
            "a printer is connected only once it has ended or was given up; else connect again"
        )
    if state is StationState.HALTING:
        return (
            "the halt may not have left, or not wholly: motors and heaters may still be on; cut "
            "the printer's power where that isn't certain, then connect again"
        )
    if state is StationState.BUSY:
        return (
            "what moves may move on, and heaters stay on: `printctl station emergency-stop` halts "
            "the printer; then connect again"
        )
    return "connect again"


def without_place(last: StationStatus) -> StationStatus:
    """Return the last status of a station that has gone: where the tip stands is unknown since."""
    return replace(
        last,
        position_mm=None,
        position_trusted=False,
        homed=(False, False, False),
        soft_low_mm=(),
        soft_high_mm=(),
    )


def records_since(journal: Path, sort: str, started: float) -> Iterator[dict[str, Any]]:
    """Yield a station's records of one sort; earlier ones are of others."""
    with contextlib.suppress(OSError):
        for record in read_records(journal):
            if record and record.get("t") == sort and record.get("at", 0.0) >= started:
                yield record


def usual_folder() -> Path:
    """Where a station is kept unless another folder is named: one printer, one bench."""
    return data_folder() / "station"
