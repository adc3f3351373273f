"""Find the rounding step of a G-code file's E, and the path length over which it averages out."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import FloatArray

_QUANTA: Final = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_SAMPLE: Final = 20_000
_MOST_MM: Final = 1.0


def last_digit_mm(plunger: FloatArray) -> float:
    """Step that the numbers of E are rounded to, mm; 0 where none coarser than 1e-6 is found."""
    some = plunger[:_SAMPLE]
    for step in _QUANTA:
        if len(some) and np.abs(some / step - np.rint(some / step)).max() < 1e-2:
            return step
    return 0.0


def window_mm(digit_ul: float, area_mm2: float) -> float:
    """Way over which a line's dose is told to 2 % of its size, mm; 1 at most.

    Two rounded numbers differ by 0.41 steps (rms) from the exact difference.

    Parameters
    ----------
    digit_ul : float, µL
        What the last digit of E stands for.
    area_mm2 : float, mm²
        Mean cross-section of the lines.
    """
    return min(0.41 * digit_ul / (0.02 * area_mm2), _MOST_MM) if area_mm2 > 0 else 0.0
