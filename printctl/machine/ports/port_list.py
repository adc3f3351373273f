"""List this computer's serial ports with description, USB id and serial number."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from serial.tools import list_ports as _tools

SIMULATED: Final = "simulated"
"""In place of a port's name, in a recipe and on the command line: a printer of our own."""


@dataclass(frozen=True)
class PortInfo:
    """A serial port of this machine.

    Attributes
    ----------
    device : str
        Name to open it by.
    description : str
        What the system calls it.
    usb_id : str
        ``VVVV:PPPP`` in hex; empty when it isn't USB.
    serial_number : str
    """

    device: str
    description: str
    usb_id: str
    serial_number: str


def list_ports() -> list[PortInfo]:
    """List the serial ports, sorted by name."""
    return sorted(
        (
            PortInfo(
                device=port.device,
                description=port.description or "",
                usb_id="" if port.vid is None else f"{port.vid:04x}:{port.pid or 0:04x}",
                serial_number=port.serial_number or "",
            )
            for port in _tools.comports()
        ),
        key=lambda info: info.device,
    )


@dataclass
class PortPrograms:
    """Programs beside this one that have a port open.

    Attributes
    ----------
    names : list of str
        Each with its process number.
    complete : bool
        Whether every process could be looked at: those of other users can't.
    """

    names: list[str] = field(default_factory=list)
    complete: bool = True


def programs_at(descriptor: int) -> PortPrograms:
    """Find the other programs that have the terminal behind ``descriptor`` open (Linux)."""
    found = PortPrograms(complete=sys.platform == "linux")
    if not found.complete:
        return found
    wanted, index = os.stat(descriptor), os.ttyname(descriptor).rpartition("/")[2]
    for folder in Path("/proc").glob("[0-9]*"):
        if folder.name == str(os.getpid()):
            continue
        try:
            opened = list(_terminals(folder))
        except PermissionError:
            found.complete = False
            continue
        except OSError:  # it has ended
            continue
        if not any(_is_same(status, wanted) for _, status in opened):
            continue
        if any(_is_far_end(folder, number, index) for number, _ in opened):
            found.complete = False  # the simulated printer's own process
            continue
        with suppress(OSError):
            name = (folder / "comm").read_text(encoding="utf-8", errors="replace").strip()
            found.names.append(f"{name}, pid {folder.name}")
    return found


def _terminals(process: Path) -> Iterator[tuple[str, os.stat_result]]:
    for link in (process / "fd").iterdir():
        with suppress(FileNotFoundError):
            if link.readlink().is_relative_to("/dev"):
                yield link.name, link.stat()


def _is_same(one: os.stat_result, other: os.stat_result) -> bool:
    """Whether both are one device; the file may differ (containers), a pseudo-terminal's not."""
    pseudo = 136 <= os.major(one.st_rdev) <= 143
    return one.st_rdev == other.st_rdev and (not pseudo or one.st_dev == other.st_dev)


def _is_far_end(process: Path, number: str, index: str) -> bool:
    """Whether a descriptor is the far end of pseudo-terminal ``index``."""
    with suppress(OSError):
        return f"tty-index:\t{index}\n" in (process / "fdinfo" / number).read_text()
    return False


def ports_found() -> str:
    """Name the ports found, for a message."""
    names = ", ".join(info.device for info in list_ports())
    return names or "none"
