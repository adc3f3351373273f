"""List serial ports, choose a printer's by its USB id, and find other programs at a port.

A port is chosen by USB id and by nothing else: other machines may be on other ports, and opening
one may reset a board. Where not exactly one port matches the profile the choice is refused, and
the candidates are listed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from serial.tools import list_ports as _tools

from firmware_profiles import Printer
from printctl.machine.errors import PortError, PortMissing

SIMULATED: Final = "simulated"
"""In place of a port's name, in a recipe and on the command line: a printer of our own."""
AUTO: Final = "auto"
"""In place of a port's name or a baud rate."""
NETWORK_HOSTS: Final = ("moonraker", "octoprint", "duet")
"""Schemes of ports behind which a program receives a whole file and runs it by itself."""
ENCRYPTED: Final = "+https"
"""Behind such a scheme: HTTP over TLS."""


def runs_files(port: str) -> bool:
    """Whether a port is a network host's (``moonraker://HOST:PORT`` and the like)."""
    scheme, found, _ = port.partition("://")
    return bool(found) and scheme.lower().removesuffix(ENCRYPTED) in NETWORK_HOSTS


@dataclass(frozen=True)
class PortInfo:
    """A serial port of this machine, opened by the name ``device``.

    ``usb_id`` is ``VVVV:PPPP`` in hex; empty when it isn't USB.
    """

    device: str
    description: str
    usb_id: str
    serial_number: str

    def __str__(self) -> str:
        words = " ".join(filter(None, (self.usb_id, self.serial_number, self.description)))
        return f"{self.device} ({words})" if words else self.device


def list_ports() -> list[PortInfo]:
    """List the serial ports, sorted by name."""
    ports = (
        PortInfo(
            device=port.device,
            description=port.description or "",
            usb_id="" if port.vid is None else f"{port.vid:04x}:{port.pid or 0:04x}",
            serial_number=port.serial_number or "",
        )
        for port in _tools.comports()
    )
    return sorted(ports, key=lambda info: info.device)


def matches(printer: Printer, port: PortInfo) -> bool:
    """Whether a port's USB id, and serial number where the profile has one, are the profile's."""
    return any(
        wanted in (port.usb_id, f"{port.usb_id}:{port.serial_number}") and port.usb_id
        for wanted in printer.usb_ids
    )


def choose_port(printer: Printer, ports: Iterable[PortInfo] | None = None) -> str:
    """Name the one of ``ports`` (by default this machine's) that has the profile's USB id.

    Raises `PortMissing` where none has it, or the profile names none; `PortError` for several.
    """
    every = list(list_ports() if ports is None else ports)
    listed = "; ".join(map(str, every)) or "none"
    if not printer.usb_ids:
        raise PortMissing(
            f"the profile of {printer.name} has no USB id (usb_ids), so no port can be selected; "
            f"ports found: {listed}; specify --port, or add the id to the profile"
        )
    matching = [port for port in every if matches(printer, port)]
    if not matching:
        raise PortMissing(
            f"no port has a USB id of {printer.name} ({', '.join(printer.usb_ids)}); ports found: "
            f"{listed}; check cable and power, or specify --port"
        )
    if len(matching) > 1:
        raise PortError(
            f"several ports have a USB id of {printer.name}: {'; '.join(map(str, matching))}; "
            "specify --port, or usb_ids with the serial number (VVVV:PPPP:SERIAL) in the profile"
        )
    return matching[0].device


def named_port(port: str, printer: Printer) -> str:
    """Return a port's name, chosen by `choose_port` where it is `AUTO`; nothing is opened."""
    return choose_port(printer) if port == AUTO else port


def read_baud(text: str | None) -> int | str | None:
    """Read a baud rate as a user gives it: a number, `AUTO`, or None for the profile's."""
    if text is None or text == AUTO:
        return text
    if not text.isdecimal() or not 300 <= int(text) <= 4_000_000:
        raise PortError(f"baud rate {text!r} is neither a number nor {AUTO}")
    return int(text)


def rates_to_try(printer: Printer) -> tuple[int, ...]:
    """Return the profile's rate, then those of its list, each once."""
    return tuple(dict.fromkeys((printer.baud, *printer.bauds)))


@dataclass
class PortPrograms:
    """Programs beside this one that have a port open, each with its process number.

    ``complete`` is whether every process could be looked at: those of other users can't.
    """

    names: list[str] = field(default_factory=list)
    complete: bool = True


def programs_at(descriptor: int) -> PortPrograms:
    """Find the other programs that have the terminal behind ``descriptor`` open (Linux)."""
    programs = PortPrograms(complete=sys.platform == "linux")
    if not programs.complete:
        return programs
    wanted, index = os.stat(descriptor), os.ttyname(descriptor).rpartition("/")[2]
    for folder in Path("/proc").glob("[0-9]*"):
        if folder.name == str(os.getpid()):
            continue
        try:
            opened = list(_terminals(folder))
        except PermissionError:
            programs.complete = False
            continue
        except OSError:  # it has ended
            continue
        if not any(_is_same(status, wanted) for _, status in opened):
            continue
        if any(_is_far_end(folder, number, index) for number, _ in opened):
            programs.complete = False  # the simulated printer's own process
            continue
        with suppress(OSError):
            name = (folder / "comm").read_text(encoding="utf-8", errors="replace").strip()
            programs.names.append(f"{name}, pid {folder.name}")
    return programs


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
