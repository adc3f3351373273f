"""Contact file ``link.json`` of a link process: address, job, port, settings, print's outcome."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

from design.files import write_text
from printctl.machine.errors import NoLink
from printctl.machine.ports.detection import SIMULATED

Kept = TypeVar("Kept")
RECORD = "link.json"
JOURNAL = "journal.log"
LOG = "link.log"
LOCK = "link.lock"
SIM_ADDRESS = "sim.address"
"""Where a simulated printer writes the port by which it is reached, in its print's folder."""


@dataclass(frozen=True)
class LinkRecord:
    """What a link process writes down about itself.

    Attributes
    ----------
    pid : int
    address, token : str
        Where it listens; empty once it has ended.
    job, profile, port : str
        Path of the job file, profile as it was given, name of the port.
    started : float
        Wall-clock time, s since 1970.
    print_id : str
        Of the print, as in its journal; empty in records of versions without.
    session : str
        Random, of this process's work on the print: another one goes on with it under another.
    baud : int or None
        In place of the profile's.
    retreat : dict
        Fields of `Retreat`.
    care : dict
        Fields of `Care`.
    status : dict
        `Status`; the last one once it has ended.
    refused : dict
        The last attempt here that came to nothing: ``pid``, ``error`` (class) and ``message``.
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

    def save(self, folder: Path) -> None:
        """Write it; readable by its owner alone, since it holds the token."""
        save_private(folder / RECORD, self)


def load_record(folder: Path) -> LinkRecord:
    """Read what `LinkRecord.save` wrote.

    Raises
    ------
    NoLink
        When no print was ever started in ``folder``, or the record can't be read.
    """
    absent = (
        f"no print was started in {folder} (no {RECORD} there); give the print's own folder, "
        "its run's folder, or its G-code file"
    )
    return read_private(folder / RECORD, LinkRecord, absent)


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


def save_private(path: Path, record: Any) -> None:
    """Write a process's record, a dataclass; readable by its owner alone."""
    write_text(path, json.dumps(asdict(record), indent=1) + "\n")
    path.chmod(0o600)


def read_private(path: Path, kind: type[Kept], absent: str) -> Kept:
    """Read what `save_private` wrote.

    Raises
    ------
    NoLink
        ``absent`` when there is no such file; or it can't be read.
    """
    try:
        return kind(**json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError as exc:
        raise NoLink(absent) from exc
    except (ValueError, TypeError, OSError) as exc:
        raise NoLink(f"{path} can't be read: {exc}") from exc
