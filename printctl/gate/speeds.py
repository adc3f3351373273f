"""Speeds and accelerations that the firmware tells (M503), against the profile's.

A firmware that is slower than its profile stretches every move: the dry run's times are wrong, and
a valve that is open for a time writes a thicker line. One that is faster accelerates harder than
was planned. Marlin tells M201 and M203 by axis, M204 P for moves that write and T for travel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from firmware_profiles import Axes, Printer

Settings = Mapping[str, Mapping[str, str]]

_SAME: Final = 0.01
"""Share by which told and profile's value may differ: M503 rounds to two decimals."""


def speeds_apart(settings: Settings, printer: Printer) -> Iterator[tuple[str, bool]]:
    """Yield each difference in words, with value and the profile's key, and if it is a slower one.

    Parameters
    ----------
    settings : mapping
        Code to words, as the firmware writes them.
    printer : Printer
    """
    for name, key, unit, told, wanted in _pairs(settings, printer):
        if abs(told - wanted) > _SAME * wanted:
            slower = told < wanted
            way = "slower" if slower else "faster"
            text = f"{name} is {told:g} {unit}, {way} than the profile's {wanted:g} ({key})"
            yield text, slower


def _pairs(settings: Settings, printer: Printer) -> Iterator[tuple[str, str, str, float, float]]:
    by_axis: tuple[tuple[str, str, str, str, Axes], ...] = (
        ("M203", "top speed", "max_speed_mm_s", "mm/s", printer.max_speed_mm_s),
        ("M201", "top acceleration", "max_acceleration_mm_s2", "mm/s²",
         printer.max_acceleration_mm_s2),
    )  # fmt: skip
    for code, what, key, unit, wanted in by_axis:
        for axis, told in settings.get(code, {}).items():
            if axis in ("X", "Y", "Z") or (axis == "E" and not printer.pneumatic):
                letter = axis.lower()
                name = f"{what} of {axis} ({code})"
                yield name, f"{key}.{letter}", unit, float(told), getattr(wanted, letter)
    for word in ("P", "T"):
        told_text = settings.get("M204", {}).get(word)
        if told_text is not None:
            name = f"acceleration (M204 {word})"
            yield name, "acceleration_mm_s2", "mm/s²", float(told_text), printer.acceleration_mm_s2
