"""Temperatures as firmwares tell them (M105), and how hot what is mounted may get."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from printctl.link.errors import Refused
from printctl.station.kit import Kit
from printctl.station.status import Temperature

UNNAMED_C: Final = 45.0
"""Hottest target while nobody said which ink or bath is there: cells and proteins bear no more."""
_READING: Final = re.compile(
    rb"(?<![\w@])([TBC])(\d*): ?(-?\d+(?:\.\d+)?)(?: ?/ ?(-?\d+(?:\.\d+)?))?"
)
_SETS: Final = {"nozzle": "M104", "bed": "M140", "chamber": "M141"}


def parse_temperatures(replies: Sequence[bytes]) -> tuple[Temperature, ...]:
    """Read a reply to M105; empty where none is in it.

    Marlin tells the nozzle in use as T, and of several each as T0, T1; Klipper as T0 alone.
    """
    found: dict[str, Temperature] = {}
    for text in replies:
        for letter, number, now, target in _READING.findall(text):
            name = _name(letter, number)
            reading = Temperature(name, float(now), float(target) if target else None)
            found.setdefault(name, reading)
    return tuple(found.values())


def _name(letter: bytes, number: bytes) -> str:
    if letter == b"T":
        return f"nozzle {int(number)}" if number and int(number) else "nozzle"
    return "bed" if letter == b"B" else "chamber"


def target_command(name: str, celsius: float) -> str:
    """What sets a heater's target without waiting for it."""
    kind, _, number = name.partition(" ")
    head = f" T{number}" if number else ""
    return f"{_SETS[kind]}{head} S{celsius:g}"


def check_target(
    known: Sequence[Temperature], name: str, celsius: float, kit: Kit, part_in_dish: bool
) -> None:
    """Refuse a heater that the printer hasn't, and a target too hot for what is mounted.

    Raises
    ------
    Refused
    """
    if celsius == 0 and name.partition(" ")[0] in _SETS:
        return  # off is always right
    names = [one.name for one in known]
    if name not in names:
        raise Refused(f"this printer tells of no {name!r}, only of {', '.join(names) or 'none'}")
    limit, why = hottest(name, kit, part_in_dish)
    if not 0 <= celsius <= limit:
        raise Refused(f"{celsius:g} °C for the {name} is outside 0 to {limit:g} °C ({why})")


def hottest(name: str, kit: Kit, part_in_dish: bool) -> tuple[float, str]:
    """Hottest target of a heater, °C, and what limits it."""
    if name.startswith("nozzle"):
        if kit.ink is not None:
            return kit.ink.temperature_c.high, f"temperature_c of {kit.ink.name}"
        return UNNAMED_C, "no ink is named; name it (mount) if it bears more"
    if kit.bath is None:
        return UNNAMED_C, "no bath is named; name it (mount) if it bears more"
    bath = kit.bath
    if part_in_dish and bath.melt_out_c is not None:
        return max(bath.melt_out_c, bath.max_printing_c), f"melt_out_c of {bath.name}"
    return bath.max_printing_c, f"max_printing_c of {bath.name}, as long as nothing is printed"
