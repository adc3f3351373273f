"""Parse temperature replies (M105); give the command that sets a heater's target."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

_READING: Final = re.compile(
    rb"(?<![\w@])([TBC])(\d*): ?(-?\d+(?:\.\d+)?)(?: ?/ ?(-?\d+(?:\.\d+)?))?"
)
_SETS: Final = {"nozzle": "M104", "bed": "M140", "chamber": "M141"}


@dataclass(frozen=True)
class Temperature:
    """One heater or sensor.

    Attributes
    ----------
    name : str
        ``nozzle`` (the ink's), ``nozzle 1`` and so on of several heads, ``bed``, ``chamber``.
    now_c : float, °C
    target_c : float or None, °C
        None where the firmware tells none; 0 is off.
    """

    name: str
    now_c: float
    target_c: float | None = None


def parse_temperatures(replies: Sequence[bytes]) -> tuple[Temperature, ...]:
    """Read a reply to M105; empty where none is in it.

    Marlin tells the nozzle in use as T, and of several each as T0, T1 too, which then count;
    Klipper tells T0 alone.
    """
    temperatures: dict[str, Temperature] = {}
    for text in replies:
        for letter, number, now, target in _READING.findall(text):
            name = _name(letter, number)
            if number or name not in temperatures:
                temperatures[name] = Temperature(
                    name, float(now), float(target) if target else None
                )
    return tuple(temperatures.values())


def _name(letter: bytes, number: bytes) -> str:
    if letter == b"T":
        return f"nozzle {int(number)}" if number and int(number) else "nozzle"
    return "bed" if letter == b"B" else "chamber"


def target_command(name: str, celsius: float) -> str:
    """What sets a heater's target without waiting for it."""
    kind, _, number = name.partition(" ")
    head = f" T{number}" if number else ""
    return f"{_SETS[kind]}{head} S{celsius:g}"
