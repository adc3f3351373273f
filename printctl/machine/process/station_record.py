"""Contact file ``station.json`` of a station: address and last known state."""

from __future__ import annotations

import contextlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from printctl.machine.control.station_status import MountedParts, StationState, StationStatus
from printctl.machine.records.folders import data_folder
from printctl.machine.records.journal import read_records
from printctl.machine.records.record import read_private, save_private

RECORD: Final = "station.json"
JOURNAL: Final = "station.journal"
LOG: Final = "station.log"
LOCK: Final = "station.lock"
SOCKET: Final = "station.sock"
_DOWN: Final = frozenset({StationState.HALTED, StationState.LOST, StationState.CLOSED})


@dataclass(frozen=True)
class StationRecord:
    """What a station writes down about itself.

    Attributes
    ----------
    pid : int
    address, token : str
        Where it listens; empty once it has ended, or before it does.
    profile, port : str
        As they were given.
    baud : int or None
    started : float
        Wall-clock time, s since 1970.
    status : dict
        `StationStatus`, as it was when the state last changed.
    plunger_mm : float or None, mm
        Of the syringe that is mounted.
    part_in_dish : bool
    sim_speed : float or None
        Of a simulated printer, times real time; None for another.
    """

    pid: int
    address: str
    token: str
    profile: str
    port: str
    baud: int | None
    started: float
    status: dict[str, Any] = field(default_factory=dict)
    plunger_mm: float | None = None
    part_in_dish: bool = False
    sim_speed: float | None = None

    def save(self, folder: Path) -> None:
        """Write it; readable by its owner alone, since it holds the token."""
        save_private(folder / RECORD, self)

    @property
    def last(self) -> StationStatus:
        """The status in it."""
        if not self.status:
            return StationStatus(StationState.CONNECTING, profile=self.profile, port=self.port)
        return StationStatus.from_dict(self.status)

    @property
    def mounted(self) -> MountedParts:
        """What was mounted; heights hung on a count that the printer may have lost."""
        mounted = self.last.mounted
        return MountedParts.from_dict({**asdict(mounted), "floor_mm": None, "bath_level_mm": None})


def load_station(folder: Path) -> StationRecord:
    """Read what `StationRecord.save` wrote.

    Raises
    ------
    NoLink
        When no station was ever opened in ``folder``, or the record can't be read.
    """
    absent = f"no printer was ever connected in {folder} (no {RECORD} there); connect first"
    return read_private(folder / RECORD, StationRecord, absent)


def journalled_down(journal: Path, since: float) -> tuple[StationState, str] | None:
    """Return the state and message that a station's journal ends in, if it was down or closed.

    Parameters
    ----------
    journal : Path
    since : float, s since 1970
        When the station was started; earlier records are of others.
    """
    last: tuple[str, str] = "", ""
    with contextlib.suppress(OSError):
        for record in read_records(journal):
            if record and record.get("t") == "state" and record.get("at", 0.0) >= since:
                last = str(record.get("state")), str(record.get("message"))
    return (StationState(last[0]), last[1]) if last[0] in _DOWN else None


def usual_folder() -> Path:
    """Where a station is kept unless another folder is named: one printer, one bench."""
    return data_folder() / "station"
