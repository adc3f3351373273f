"""Single-precision E step arithmetic of Marlin on an 8-bit board.

A number is read as avr-libc reads it: its digits as a whole number, then multiplied by powers of
ten in single precision, so that 0.321 becomes the float below the nearest one. Marlin keeps E as a
32-bit float, in mm, and moves the motor to the nearest step of each move's end.
``G92 E`` renumbers the planner's count to the nearest step of the new value, so the part of a step
that was pending is dropped: over hundreds of G92 this walks away from the sum of the file's mm.
"""

from __future__ import annotations

import numpy as np

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
