"""Single-precision E step arithmetic of Marlin on an 8-bit board.

A number is read as avr-libc reads it: its digits as a whole number, then multiplied by powers of
ten in single precision, so that 0.321 becomes the float below the nearest one. Marlin keeps E as a
32-bit float, in mm, and moves the motor to the nearest step of each move's end.
``G92 E`` renumbers the planner's count to the nearest step of the new value, so the part of a step
that was pending is dropped: over hundreds of G92 this walks away from the sum of the file's mm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import numpy as np

_WORD = re.compile(r"([A-Z])(-?[0-9.]+)")
_MOVES = frozenset({"G0", "G1", "G2", "G3"})


_TENTHS = tuple((power, np.float32(f"1e-{power}")) for power in (32, 16, 8, 4, 2, 1))
"""Powers of ten that a fraction is multiplied by, the largest first."""


def as_avr_reads(text: str) -> np.float32:
    """Read a decimal as avr-libc's strtod does, which is single precision on that board."""
    whole, _, fraction = text.lstrip("-").partition(".")
    value, places = np.float32(int(whole + fraction or "0")), len(fraction)
    for power, tenth in _TENTHS:
        while places >= power:
            value, places = np.float32(value * tenth), places - power
    return np.float32(-value) if text.startswith("-") else value


class MarlinPlunger:
    """Counts steps of E, line by line, as a Marlin on an 8-bit board does.

    Parameters
    ----------
    steps_per_mm : float

    Attributes
    ----------
    motor : int
        Steps of the motor so far.
    apart : int
        How often a board's motor was found elsewhere; counted by who compares.
    """

    def __init__(self, steps_per_mm: float) -> None:
        self._per_mm = np.float32(steps_per_mm)
        self._e_mm = np.float32(0.0)
        self._planned = 0
        self._relative = False
        self.motor = self.apart = 0

    def take(self, line: str) -> None:
        """Take a line as the product sends it: upper case, words apart, no remark."""
        code, _, rest = line.partition(" ")
        if code in ("G90", "M82", "G91", "M83"):
            self._relative = code in ("G91", "M83")
        words = dict(_WORD.findall(rest)) if code in _MOVES or code == "G92" else {}
        if "E" not in words:
            return
        said = as_avr_reads(words["E"])
        if code == "G92":
            self._e_mm, self._planned = said, self._steps(said)
            return
        self._e_mm = np.float32(self._e_mm + said) if self._relative else said
        self.motor += self._steps(self._e_mm) - self._planned
        self._planned = self._steps(self._e_mm)

    def take_all(self, lines: Iterable[str]) -> int:
        """Take lines; return the motor's steps."""
        for line in lines:
            self.take(line)
        return self.motor

    def _steps(self, e_mm: np.float32) -> int:
        """Round half away from zero, as C's lround does."""
        product = float(np.float32(e_mm * self._per_mm))
        return int(math.copysign(math.floor(abs(product) + 0.5), product))
