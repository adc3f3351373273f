"""Number of decimals of each G-code word."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer

FLOAT32_DIGITS: Final = 2**23
"""A float32 holds whole quanta exactly up to this many, and four times as finely to a quarter."""


@dataclass(frozen=True)
class Decimals:
    """Digits after the point for X, Y, Z and E.

    Positions have three, or as many as make the last digit finer than a quarter of a motor step;
    E as many as that needs.
    """

    x: int
    y: int
    z: int
    e: int

    @property
    def e_limit_quanta(self) -> int:
        """Largest E, in its last digit, of which float32 still keeps a quarter of that digit."""
        return FLOAT32_DIGITS // 4


def decimals_for(printer: Printer) -> Decimals:
    """Digits that the printer's steps need."""
    steps = printer.steps_per_mm
    return Decimals(
        x=max(3, _digits(steps.x)),
        y=max(3, _digits(steps.y)),
        z=max(3, _digits(steps.z)),
        e=_digits(steps.e),
    )


def _digits(steps_per_mm: float) -> int:
    """Fewest digits whose quantum is below a quarter of a step."""
    return max(0, math.floor(math.log10(4.0 * steps_per_mm)) + 1)
