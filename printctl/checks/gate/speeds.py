"""Compare the firmware's speed, acceleration and jerk limits (M503) with the profile's.

A firmware that is slower than its profile stretches every move: the dry run's times are wrong, and
a valve that is open for a time writes a thicker line. One that is faster accelerates harder than
was planned. Marlin tells M201 and M203 by axis, M204 P for moves that write, R for those of the
plunger alone and T for travel. M205 tells the corners (J), the least time of a segment (B), and the
speeds below which no move is made (S, T): what is planned as slower is then made faster, and no
check counts on that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from firmware_profiles import Axes, Printer

Settings = Mapping[str, Mapping[str, str]]

_SAME: Final = 0.01
"""Share by which told and profile's value may differ: M503 rounds to two decimals."""
_ROUNDED: Final = 0.005 + 1e-9
"""What two decimals hide of a junction deviation, mm (0.013 is told as 0.01)."""


def speeds_apart(settings: Settings, printer: Printer) -> Iterator[tuple[str, bool]]:
    """Yield each difference in words, and whether a line that ink is pressed into by time is wrong.

    Parameters
    ----------
    settings : mapping
        Code to words, as the firmware writes them.
    printer : Printer
    """
    for name, key, unit, reported, wanted in _pairs(settings, printer):
        if abs(reported - wanted) > _SAME * wanted:
            slower = reported < wanted
            way = "slower" if slower else "faster"
            text = f"{name} is {reported:g} {unit}, {way} than the profile's {wanted:g} ({key})"
            yield text, slower
    yield from _advanced_apart(settings.get("M205", {}), printer)


def _advanced_apart(words: Mapping[str, str], printer: Printer) -> Iterator[tuple[str, bool]]:
    """Yield the same for what M205 tells."""
    wanted = printer.junction_deviation_mm
    corner = float(words.get("J", wanted))
    if abs(corner - wanted) > _ROUNDED:
        way = "slower" if corner < wanted else "faster"
        text = f"junction deviation (M205 J) is {corner:g} mm, {way} than the profile's {wanted:g}"
        yield f"{text} (junction_deviation_mm)", corner < wanted
    wanted_us = printer.min_segment_time_s * 1e6
    segment = float(words.get("B", wanted_us))
    if abs(segment - wanted_us) > _SAME * wanted_us:
        way = "slower" if segment > wanted_us else "faster"
        text = f"least time of a segment (M205 B) is {segment:g} µs, {way} than the profile's"
        yield f"{text} {wanted_us:g} (min_segment_time_s)", segment > wanted_us
    for word, moves in (("S", "moves that write"), ("T", "travels")):
        least = float(words.get(word, 0))
        if least > 0:
            text = f"least speed of {moves} (M205 {word}) is {least:g} mm/s, faster than the"
            yield f"{text} profile's 0; M205 {word}0 takes it back", word == "S"


def _pairs(settings: Settings, printer: Printer) -> Iterator[tuple[str, str, str, float, float]]:
    by_axis: tuple[tuple[str, str, str, str, Axes], ...] = (
        ("M203", "top speed", "max_speed_mm_s", "mm/s", printer.max_speed_mm_s),
        ("M201", "top acceleration", "max_acceleration_mm_s2", "mm/s²",
         printer.max_acceleration_mm_s2),
    )  # fmt: skip
    for code, what, key, unit, wanted in by_axis:
        for axis, reported in settings.get(code, {}).items():
            if axis in ("X", "Y", "Z") or (axis == "E" and not printer.pneumatic):
                letter = axis.lower()
                name = f"{what} of {axis} ({code})"
                yield name, f"{key}.{letter}", unit, float(reported), getattr(wanted, letter)
    for word in "PT" if printer.pneumatic else "PRT":
        told_text = settings.get("M204", {}).get(word)
        if told_text is not None:
            name = f"acceleration (M204 {word})"
            yield name, "acceleration_mm_s2", "mm/s²", float(told_text), printer.acceleration_mm_s2
