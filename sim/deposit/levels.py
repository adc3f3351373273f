"""Layer heights found in executed motion, and the heights of the lines printed there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.errors import DepositError

FloatArray = NDArray[np.float64]

LEVEL_TOLERANCE_MM = 5e-3
"""Written heights closer than this are one level (two steps of a usual z axis)."""
_THICKER = 1.5
"""Lines that hold so many times the usual cross-section are higher, not wider."""


def written_levels(heights: FloatArray) -> FloatArray:
    """Distinct written heights, ascending, mm."""
    ordered = np.unique(np.round(heights, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    return ordered[new]


def level_heights(levels: FloatArray, area_mm2: FloatArray) -> FloatArray:
    """Height of the lines of each level: down to the level below, (k,), mm.

    A slicer that varies its layers keeps its lines' width, so a level whose lines hold more than
    the usual ones may be as much higher. One that hangs more than twice so high above the last
    takes that height, or where its lines are the usual ones the most frequent spacing. The lowest
    takes the next one's where its lines hold as much for it, else the most frequent spacing.

    Parameters
    ----------
    levels : (k,) float64, mm
        Ascending.
    area_mm2 : (k,) float64, mm²
        Median cross-section of each level's lines.
    """
    gaps = np.diff(levels)
    if len(gaps) == 0:
        raise DepositError(
            "layered writing has a single level, so its line height is unknown; "
            "use style='embedded' or write at least two layers"
        )
    values, counts = np.unique(np.round(gaps, 3), return_counts=True)
    usual = float(values[counts.argmax()])
    more = area_mm2 / np.median(area_mm2[1:][np.abs(gaps - usual) < 1e-3])
    likely = np.where(more > _THICKER, more * usual, usual)[1:]
    gaps = np.where(gaps > 2 * likely, likely, gaps)
    fits = 1 / _THICKER < more[0] * usual / gaps[0] < _THICKER
    return np.concatenate([[gaps[0] if fits else usual], gaps])


def level_areas(levels: FloatArray, heights: FloatArray, area_mm2: FloatArray) -> FloatArray:
    """Median cross-section of the lines at each level, (k,), mm².

    Parameters
    ----------
    levels : (k,) float64, mm
        Of `written_levels`.
    heights, area_mm2 : (n,) float64, mm and mm²
        Of each line.
    """
    order = np.argsort(heights, kind="stable")
    first = np.searchsorted(heights[order], levels - 1e-6)
    return np.array([np.median(own) for own in np.split(area_mm2[order], first[1:])])
