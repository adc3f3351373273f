"""Contact files of processes: address, profile, port, settings, last status."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from printctl.machine.errors import NoLink
from printctl.machine.ports.detection import SIMULATED

RECORD = "link.json"
JOURNAL = "journal.log"
LOG = "link.log"
LOCK = "link.lock"
SIM_ADDRESS = "sim.address"
"""Where a simulated printer writes the port by which it is reached, in its print's folder."""


_PRINTS_OWN: Final = ("job", "retreat", "care", "refused", "print_id", "session", "key_file")
_STATIONS_OWN: Final = ("sim_speed",)


@dataclass(frozen=True)
class ContactRecord:
    """What a process writes down: ``link.json`` of a print, ``station.json`` of a station.

    Attributes
    ----------
    address, token : str
        Where it listens; empty before it does, and once it has ended. A print on a station names
        the station's.
    job, profile, port : str
        Path of the print's job file, profile as it was given, name of the port.
    started : float
        Wall-clock time, s since 1970.
    baud : int or None
        In place of the profile's.
    retreat, care : dict
        Fields of `Retreat`, and of `Care`.
    status : dict
        `Status` of a print once it has ended; `StationStatus` when its state last changed.
    refused : dict
        The last attempt here that came to nothing: ``pid``, ``error`` (class) and ``message``.
    print_id : str
        Of the print, as in its journal; empty in records of versions without.
    session : str
        Random, of this process's work on the print: another one goes on with it under another.
    key_file : str
        Path of the file with a network host's key; the key itself is written nowhere.
    sim_speed : float or None
        Of a station's simulated printer, times real time; None for another.
    """

    pid: int
    address: str
    token: str
    job: str
    profile: str
    port: str
    started: float
    baud: int | None = None
    retreat: dict[str, Any] = field(default_factory=dict)
    care: dict[str, Any] = field(default_factory=dict)
    status: dict[str, Any] = field(default_factory=dict)
    refused: dict[str, Any] = field(default_factory=dict)
    print_id: str = ""
    session: str = ""
    key_file: str = ""
    sim_speed: float | None = None

    def save(self, folder: Path, name: str = RECORD) -> None:
        """Write it; readable by its owner alone, since it holds the token."""
        others = _STATIONS_OWN if name == RECORD else _PRINTS_OWN
        data = {key: value for key, value in asdict(self).items() if key not in others}
        write_text(folder / name, json.dumps(data, indent=1) + "\n")
        (folder / name).chmod(0o600)


def load_record(folder: Path) -> ContactRecord:
    """Read a print's record; NoLink when none was started in ``folder``, or it can't be read."""
    absent = (
        f"no print was started in {folder} (no {RECORD} there); give the print's own folder, "
        "its run's folder, or its G-code file"
    )
    return read_contact(folder / RECORD, absent)


REHEARSAL: Final = ".rehearsal"
"""End of the name of a run's folder in which only simulated printers print."""


def reported_port(folder: Path, port: str) -> str:
    """Return the port of a folder's print, ``simulated`` where a simulated printer was behind it.

    Where the print went to another port, the address is left of an earlier rehearsal.
    """
    if folder.parent.name.endswith(REHEARSAL):
        return SIMULATED
    try:
        simulated = (folder / SIM_ADDRESS).read_text().partition("\n")[0].strip() == port
    except (OSError, ValueError):
        return port
    return SIMULATED if simulated else port


def read_contact(path: Path, absent: str) -> ContactRecord:
    """Read what `ContactRecord.save` wrote.

    Raises
    ------
    NoLink
        ``absent`` when there is no such file; or it can't be read.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        known = {key: data[key] for key in ContactRecord.__dataclass_fields__ if key in data}
        return ContactRecord(**{"job": "", **known})
    except FileNotFoundError as exc:
        raise NoLink(absent) from exc
    except (ValueError, TypeError, OSError) as exc:
        raise NoLink(f"{path} can't be read: {exc}") from exc
