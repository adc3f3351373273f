"""Written heights of layers, and how high their lines are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.errors import DepositError

FloatArray = NDArray[np.float64]

LEVEL_TOLERANCE_MM = 5e-3
"""Written heights closer than this are one level (two steps of a usual z axis)."""


def written_levels(heights: FloatArray) -> FloatArray:
    """Distinct written heights, ascending, mm."""
    ordered = np.unique(np.round(heights, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    return ordered[new]


def level_heights(levels: FloatArray) -> FloatArray:
    """Height of the lines of each level: down to the level below, (k,), mm.

    The lowest level, and one that hangs more than two usual spacings above the last, take the
    most frequent spacing.
    """
    gaps = np.diff(levels)
    if len(gaps) == 0:
        raise DepositError(
            "layered writing has a single level, so its line height is unknown; "
            "use style='embedded' or write at least two layers"
        )
    values, counts = np.unique(np.round(gaps, 3), return_counts=True)
    usual = float(values[counts.argmax()])
    gaps = np.where(gaps > 2 * usual, usual, gaps)
    return np.concatenate([[usual], gaps])
