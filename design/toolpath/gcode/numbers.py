"""Decimals per G-code axis from motor steps; largest plunger move that float32 still resolves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from design.errors import ToolpathError
from firmware_profiles import Printer, ProfileError
from firmware_profiles.families import family_of
from firmware_profiles.families.dialect import Dialect

FLOAT32_WHOLE: Final = 2**24
"""A float32 holds every whole number up to this one."""
_E_DIGITS: Final = 7
"""The most with which a float32 holds a whole millimetre and its last digit; E is counted anew by
whole millimetres. A motor step is several short moves' ink, each of which must still have its own
dose: 0.1 mm of a line 0.15 x 0.06 mm is 5e-5 mm in a bore of 4.61 mm."""


@dataclass(frozen=True)
class Decimals:
    """Digits after the point for X, Y, Z and E.

    Positions have three, or as many as make the last digit finer than a quarter of a motor step.

    Attributes
    ----------
    x, y, z, e : int
    e_move_mm : float, mm
        Largest push of one move: so large an E still has, in a float32, a quarter of the first
        digit finer than a quarter of a motor step.
    """

    x: int
    y: int
    z: int
    e: int
    e_move_mm: float

    @property
    def e_limit_quanta(self) -> int:
        """Largest E, in its last digit, of which float32 still keeps that digit."""
        return FLOAT32_WHOLE


def decimals_for(printer: Printer) -> Decimals:
    """Digits that the printer's steps need."""
    steps = printer.steps_per_mm
    return Decimals(
        x=max(3, _digits(steps.x)),
        y=max(3, _digits(steps.y)),
        z=max(3, _digits(steps.z)),
        e=_E_DIGITS,
        e_move_mm=FLOAT32_WHOLE / 8 / 10 ** _digits(steps.e),
    )


def _digits(steps_per_mm: float) -> int:
    """Fewest digits whose quantum is below a quarter of a step."""
    return max(0, math.floor(math.log10(4.0 * steps_per_mm)) + 1)


def dialect_of(printer: Printer) -> Dialect:
    """Return the dialect of the printer's firmware.

    Raises
    ------
    ToolpathError
        When there is none, or the profile doesn't say enough to choose it.
    """
    try:
        return family_of(printer).dialect(printer)
    except ProfileError as exc:
        raise ToolpathError(f"no G-code can be written: {exc}") from exc
