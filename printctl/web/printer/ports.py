"""List serial ports with matching printer profiles; describe a profile in one line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from printctl.machine.link.port_detection import matches
from printctl.machine.link.ports import PortInfo, list_ports
from printctl.web.profile_store import ProfileStore

SIMULATED: Final = "simulated"


@dataclass(frozen=True)
class FoundPort:
    """A port, and the profiles whose USB id it has."""

    device: str
    description: str
    usb_id: str
    serial_number: str
    profiles: tuple[str, ...]


def ports_with_profiles(
    store: ProfileStore, ports: list[PortInfo] | None = None
) -> list[FoundPort]:
    """List this machine's serial ports; nothing is opened."""
    printers = {name: store.load(Printer, name) for name in store.printers()}
    return [
        FoundPort(
            port.device,
            port.description,
            port.usb_id,
            port.serial_number,
            tuple(name for name, printer in printers.items() if matches(printer, port)),
        )
        for port in (list_ports() if ports is None else ports)
    ]


def summary(printer: Printer) -> str:
    """What a printer is, on one line."""
    x, y, z = (f"{s.low:g} to {s.high:g}" for s in (printer.x_mm, printer.y_mm, printer.z_mm))
    pushes = (
        f"pneumatic, {printer.pneumatic.pressure_kpa:g} kPa"
        if printer.pneumatic
        else f"plunger, {printer.plunger_travel_mm:g} mm of travel"
    )
    heads = f", {printer.head_count} heads" if printer.heads else ""
    return (
        f"{printer.name}: {printer.firmware}, {printer.baud} Bd, X {x}, Y {y}, Z {z} mm; "
        f"{pushes}{heads}"
    )


def unmeasured(printer: Printer) -> str:
    """Which of its numbers are starting values; empty for none."""
    if not printer.starting_values:
        return ""
    return (
        f"Starting values, to be measured or compared with the machine: "
        f"{', '.join(printer.starting_values)}"
    )
