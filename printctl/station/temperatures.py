"""Temperatures as firmwares tell them (M105), and how hot what is mounted may get."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from printctl.gate import Limit
from printctl.station.mounted_profiles import MountedProfiles
from printctl.station.status import Temperature

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


def heat_limits(profiles: MountedProfiles, part_in_dish: bool) -> dict[str, Limit]:
    """Hottest targets that what is mounted bears, by heater."""
    found = {}
    if profiles.ink is not None:
        found["nozzle"] = Limit(
            profiles.ink.temperature_c.high, f"temperature_c of {profiles.ink.name}"
        )
    bath = profiles.bath
    if bath is None:
        return found
    if part_in_dish and bath.melt_out_c is not None:
        hottest = Limit(max(bath.melt_out_c, bath.max_printing_c), f"melt_out_c of {bath.name}")
    else:
        why = f"max_printing_c of {bath.name}, as long as nothing is printed"
        hottest = Limit(bath.max_printing_c, why)
    return {**found, "bed": hottest, "chamber": hottest}
