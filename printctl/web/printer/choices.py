"""Choices: serial ports with matching profiles, printers, and parts to be mounted."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, ProfileError, Syringe
from printctl.machine.link.port_detection import matches, rates_to_try
from printctl.machine.link.ports import PortInfo, list_ports
from printctl.web.profile_store import PARTS, ProfileStore


@dataclass(frozen=True)
class FoundPort(PortInfo):
    """A port, and the profiles whose USB id it has."""

    profiles: tuple[str, ...]


@dataclass(frozen=True)
class PrinterChoice:
    """A printer profile that can be connected.

    ``starting_values`` are keys whose values weren't measured at the machine. ``bauds`` (Bd) begin
    with the profile's own, then those that ``auto`` tries.
    """

    name: str
    summary: str
    starting_values: tuple[str, ...]
    bauds: tuple[int, ...]


@dataclass(frozen=True)
class PartChoice:
    """A part that can be mounted; ``volume_ul`` is a syringe's."""

    name: str
    about: str
    volume_ul: float | None = None


def ports_with_profiles(store: ProfileStore) -> list[FoundPort]:
    """List this machine's serial ports; nothing is opened."""
    printers = {name: store.load(Printer, name) for name in store.printers()}
    return [
        FoundPort(
            **asdict(port), profiles=tuple(n for n, p in printers.items() if matches(p, port))
        )
        for port in list_ports()
    ]


def printer_choices(store: ProfileStore) -> list[PrinterChoice]:
    """List printer profiles that can be connected."""
    listed = []
    for name in store.printers():
        printer = store.load(Printer, name)
        known = printer.starting_values, rates_to_try(printer)
        listed.append(PrinterChoice(name, summary(printer), *known))
    return listed


def part_choices(store: ProfileStore) -> dict[str, list[PartChoice]]:
    """List needles, syringes, inks, dishes and baths."""
    return {
        sort: [_part(store, model, name) for name in store.names(model)]
        for sort, model in PARTS.items()
    }


def _part(store: ProfileStore, model: type[Facts], name: str) -> PartChoice:
    try:
        part = store.load(model, name)
    except (ProfileError, OSError) as exc:  # a file of the user's own; mounting it is refused
        return PartChoice(name, f"can't be read: {exc}")
    if isinstance(part, Needle):
        return PartChoice(name, f"bore {part.inner_mm:g} mm, {part.length_mm:g} mm long")
    if isinstance(part, Syringe):
        return PartChoice(name, f"{part.volume_ul:g} µL", part.volume_ul)
    if isinstance(part, Ink):
        low, high = part.temperature_c.low, part.temperature_c.high
        return PartChoice(name, f"held at {low:g} to {high:g} °C")
    if isinstance(part, Dish):
        wide = "Ø " if part.shape == "round" else f"{part.inner_x_mm:g} × "
        return PartChoice(name, f"{wide}{part.inner_y_mm:g} mm, wall {part.wall_mm:g} mm")
    assert isinstance(part, Bath)
    return PartChoice(name, f"yields at {part.yield_stress_pa:g} Pa")


def summary(printer: Printer) -> str:
    """Describe a printer on one line."""
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
