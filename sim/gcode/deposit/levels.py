"""Layer heights found in executed motion, and the heights of the lines printed there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.errors import DepositError
from sim.gcode.deposit.strands import Strands

LEVEL_TOLERANCE_MM = 5e-3
"""Written heights closer than this are one level (two steps of a usual z axis)."""
_THICKER = 1.5
"""Lines that hold so many times the usual cross-section are higher, not wider."""


def written_levels(heights: FloatArray) -> FloatArray:
    """Distinct written heights, ascending, mm."""
    ordered = np.unique(np.round(heights, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    return ordered[new]


def level_heights(
    levels: FloatArray, area_mm2: FloatArray, single_mm: float | None = None
) -> FloatArray:
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
    single_mm : float or None, mm
        Height of the lines of a single level: of a print that has but begun.

    Raises
    ------
    DepositError
        When there is a single level, and its height isn't given.
    """
    gaps = np.diff(levels)
    if len(gaps) == 0 and single_mm is not None:
        return np.array([single_mm])
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


@dataclass(frozen=True)
class Layering:
    """Levels of layered writing.

    Attributes
    ----------
    levels, height_mm : (k,) float64, mm
        Where the tip wrote, ascending; and how far the lines hang below it.
    """

    levels: FloatArray
    height_mm: FloatArray

    @staticmethod
    def of(lines: Strands, single_mm: float | None = None) -> Layering:
        """Find them in written lines; `single_mm` as of `level_heights`."""
        levels = written_levels(lines.end[:, 2])
        area = level_areas(levels, lines.end[:, 2], lines.area_mm2)
        return Layering(levels, level_heights(levels, area, single_mm))

    def number(self, z_mm: FloatArray) -> IntArray:
        """Level of each written height, (n,)."""
        return np.clip(np.searchsorted(self.levels, z_mm + 1e-6, side="right") - 1, 0, None)

    def heights(self, z_mm: FloatArray) -> FloatArray:
        """Height of the lines that are written there, (n,), mm."""
        return self.height_mm[self.number(z_mm)]
