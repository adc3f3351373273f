"""Find rows or columns missing from a height map, by an earlier one.

A profiler that misses triggers of its stage delivers fewer profiles, and all behind them lies
aside. Where the map's end still shows unchanged ground where the earlier map did, it merely ended
early, and nothing lies aside. A program that fills a short map up to its usual size (repeated or
stretched rows) hides the loss; but where edges lie aside, what stood there before is gone.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.values import FloatImage

END_SHARE: Final = 0.3
"""Share of a map's or its lines' extent that counts as an end."""
MAX_MOVE_MM: Final = 2.0
"""Largest move of an end that is searched."""
MIN_MOVE_MM: Final = 0.1
"""Least move of an end; a layer's own shift may be as large."""
_MAX_SAMPLES: Final = 8_000
"""Cells of an end that are compared, about."""
_MIN_CELLS: Final = 400
"""Least number of unchanged cells in an end."""
_MIN_UNCHANGED_SHARE: Final = 0.2
"""Least share of unchanged cells in an end for it to be compared."""
_MAX_MISFIT: Final = 0.4
"""Largest misfit, relative to the end's relief, of two maps that fit."""
_MAX_MISFIT_OVER_MEDIAN: Final = 0.6
"""Largest misfit relative to the median over moves: bare ground and lines along the rows fit at any
move."""
_MAX_SINK_THICKNESSES: Final = 0.5
"""Largest sinking of standing ink between looks, in thicknesses."""
_MIN_STRIP_MM: Final = 0.05
"""Least width of lowered ink, at least two cells: steep flanks scatter between maps."""


def count_lost_rows(
    now: FloatImage, last: FloatImage, still: BoolArray, cell_mm: tuple[float, float]
) -> tuple[int, int]:
    """Count rows and columns that a map lost before its end, against an earlier one.

    Parameters
    ----------
    now, last : (rows, columns) float32, mm
        Heights, NaN where lost; both begin at the same place.
    still : (rows, columns) bool
        Of the earlier map, where nothing was written since.
    cell_mm : (float, float), mm
        From row to row, and from column to column.
    """
    rows = _lost(now, last, still, cell_mm[0])
    return rows, _lost(now.T, last.T, still.T, cell_mm[1])


def lowered_area_mm2(
    rise_mm: FloatImage, thickness_mm: float, cell_mm: tuple[float, float]
) -> float:
    """Return the area on which earlier ink now lies lower by half a layer, mm².

    Ink doesn't go away: it was moved in the dish, or in the map.

    Parameters
    ----------
    rise_mm : (rows, columns) float32, mm
        Over the earlier map; NaN where either isn't known.
    thickness_mm : float, mm
        Of a layer.
    cell_mm : (float, float), mm
        From row to row, and from column to column.
    """
    lower = np.nan_to_num(rise_mm, nan=0.0) < -_MAX_SINK_THICKNESSES * thickness_mm
    high, wide = (max(2, round(_MIN_STRIP_MM / one)) for one in cell_mm)
    kernel = np.ones((high, wide), np.uint8)
    strips = cv2.morphologyEx(lower.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    return float(cv2.countNonZero(strips)) * cell_mm[0] * cell_mm[1]


def _lost(now: FloatImage, last: FloatImage, still: BoolArray, cell_mm: float) -> int:
    fewer = len(last) - len(now)
    if fewer < max(2, round(MIN_MOVE_MM / cell_mm)):
        return 0
    return 0 if _ends_in_place(now, last, still, max(2, round(MAX_MOVE_MM / cell_mm))) else fewer


def _ends_in_place(now: FloatImage, last: FloatImage, still: BoolArray, reach: int) -> bool:
    """Return whether the last rows fit the earlier map best without a move."""
    first, wide = len(now) - round(END_SHARE * len(now)), min(now.shape[1], last.shape[1])
    step = max(1, (len(now) - first) * wide // _MAX_SAMPLES)
    some = np.s_[:, :wide:step]
    own, earlier, unchanged = now[some], last[some], still[some]
    moves = range(-reach, reach + 1)
    found = np.array([_misfit(own, earlier, unchanged, first, by) for by in moves])
    sure = found[reach] < min(_MAX_MISFIT, _MAX_MISFIT_OVER_MEDIAN * float(np.median(found)))
    return bool(sure and abs(int(found.argmin()) - reach) <= 1)


def _misfit(now: FloatImage, last: FloatImage, still: BoolArray, first: int, by: int) -> float:
    """Return the rows' misfit from ``first`` on, moved, over their relief; inf for too few."""
    low = max(first + by, 0)
    high = max(low, min(len(now) + by, len(last)))
    own, unchanged = now[low - by : high - by], still[low:high]
    off = (own - last[low:high])[unchanged]
    known = np.isfinite(off)
    if known.sum() < max(_MIN_CELLS, _MIN_UNCHANGED_SHARE * np.isfinite(now[first:]).sum()):
        return np.inf
    return _relief(off[known]) / max(_relief(own[unchanged][known]), 1e-9)


def _relief(values: FloatArray | FloatImage) -> float:
    """Return the mean absolute deviation from the median."""
    return float(np.mean(np.abs(values - np.median(values))))
