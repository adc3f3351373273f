"""List this computer's serial ports with description, USB id and serial number."""

from __future__ import annotations

from dataclasses import dataclass
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


def ports_found() -> str:
    """Name the ports found, for a message."""
    names = ", ".join(info.device for info in list_ports())
    return names or "none"
