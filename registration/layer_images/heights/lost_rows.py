"""Find rows or columns that a height map lacks, by an earlier map of the same place.

A profiler that misses triggers of its stage delivers fewer profiles, and all behind them lies
aside. Where the map's end still shows unchanged ground where the earlier map did, it merely ended
early, and nothing lies aside. A program that fills a short map up to its usual size (repeated or
stretched rows) hides the loss: then parts of the unchanged ground lie aside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from registration.layer_images.values import BoolArray, FloatArray, FloatImage

_PART: Final = 0.3
"""Of the rows: what counts as the map's end, and how long a part of it is."""
_STARTS: Final = (0.0, 0.175, 0.35, 0.525, 0.7)
"""Of the rows: where parts begin."""
_REACH_MM: Final = 2.0
LEAST_MM: Final = 0.1
"""Fewer rows may be lost: a layer may lie as far beside its place."""
_SAMPLES: Final = 8_000
_FEWEST: Final = 400
_ENOUGH: Final = 0.2
"""Of the end's cells: where fewer are unchanged they tell nothing."""
_FITS: Final = 0.4
"""Of the end's relief, that differs at most where two maps fit."""
_BETTER: Final = 0.6
"""Times what differs at most other places: bare ground and lines along the rows fit anywhere."""
_SMOOTH_MM: Final = 0.5
"""Relief is what is rougher: tilt and bow fit anywhere."""
_TALLEST: Final = 4.0
"""Times the middle relief, that single heights count for."""
_ALIKE: Final = 0.4
"""Correlation of two parts from which on they show the same ground."""
_AS_MUCH: Final = 0.5
"""Of the best correlation: where it is higher in place, nothing is moved."""
_SINGLE: Final = 0.8
"""Of the best correlation, that none may reach elsewhere: lines of one pitch fit many times."""
_CHECKED: Final = 3
"""Parts in place, from which on a map counts as checked."""


@dataclass(frozen=True)
class Slid:
    """How parts of a map lie against an earlier one of as many rows.

    Attributes
    ----------
    by : int
        Rows by which the part that lies farthest aside is moved; 0 for none.
    checked : bool
        Whether most parts surely lie in place.
    """

    by: int
    checked: bool


def lost_rows(
    now: FloatImage, last: FloatImage, still: BoolArray, cell_mm: tuple[float, float]
) -> tuple[int, int]:
    """Return how many rows and columns a map lacks before its end, against an earlier one.

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


def slid_rows(
    now: FloatImage, last: FloatImage, still: BoolArray, cell_mm: tuple[float, float]
) -> tuple[Slid, Slid]:
    """Return how parts of a map lie against an earlier one, along rows and along columns.

    Parameters are those of `lost_rows`.
    """
    rows, columns = (min(one) for one in zip(now.shape, last.shape, strict=True))
    cut = np.s_[:rows, :columns]
    own, earlier = (_rough(one[cut], cell_mm) for one in (now, last))
    unchanged = still[cut]
    return (
        _slid(own, earlier, unchanged, cell_mm[0]),
        _slid(own.T, earlier.T, unchanged.T, cell_mm[1]),
    )


def _lost(now: FloatImage, last: FloatImage, still: BoolArray, cell_mm: float) -> int:
    fewer = len(last) - len(now)
    if fewer < max(2, round(LEAST_MM / cell_mm)):
        return 0
    return 0 if _ends_in_place(now, last, still, max(2, round(_REACH_MM / cell_mm))) else fewer


def _ends_in_place(now: FloatImage, last: FloatImage, still: BoolArray, reach: int) -> bool:
    """Whether the last rows surely fit the earlier map as they are, and not moved."""
    first, wide = len(now) - round(_PART * len(now)), min(now.shape[1], last.shape[1])
    step = max(1, (len(now) - first) * wide // _SAMPLES)
    some = np.s_[:, :wide:step]
    own, earlier, unchanged = now[some], last[some], still[some]
    moves = range(-reach, reach + 1)
    found = np.array([_misfit(own, earlier, unchanged, first, by) for by in moves])
    sure = found[reach] < min(_FITS, _BETTER * float(np.median(found)))
    return bool(sure and abs(int(found.argmin()) - reach) <= 1)


def _misfit(now: FloatImage, last: FloatImage, still: BoolArray, first: int, by: int) -> float:
    """Share of the relief of the rows from ``first`` on that differs, moved; infinite for none."""
    low = max(first + by, 0)
    high = max(low, min(len(now) + by, len(last)))
    own, unchanged = now[low - by : high - by], still[low:high]
    off = (own - last[low:high])[unchanged]
    known = np.isfinite(off)
    if known.sum() < max(_FEWEST, _ENOUGH * np.isfinite(now[first:]).sum()):
        return np.inf
    return _relief(off[known]) / max(_relief(own[unchanged][known]), 1e-9)


def _relief(values: FloatArray | FloatImage) -> float:
    """Mean distance from the median."""
    return float(np.mean(np.abs(values - np.median(values))))


def _rough(heights: FloatImage, cell_mm: tuple[float, float]) -> FloatImage:
    """Heights over their surroundings, single ones cut off; NaN where not measured."""
    known = np.isfinite(heights)
    sigma = (_SMOOTH_MM / cell_mm[1], _SMOOTH_MM / cell_mm[0])
    total, share = (
        cv2.GaussianBlur(one.astype(np.float32), (0, 0), sigma[0], sigmaY=sigma[1])
        for one in (np.where(known, heights, 0.0), known)
    )
    off = heights - total / np.maximum(share, np.float32(1e-3))
    most = _TALLEST * float(np.median(np.abs(off[known]))) if known.any() else 0.0
    return np.asarray(np.clip(off, -most, most), dtype=np.float32)


def _slid(now: FloatImage, last: FloatImage, still: BoolArray, cell_mm: float) -> Slid:
    rows, reach = len(now), max(2, round(_REACH_MM / cell_mm))
    least, size = max(2, round(LEAST_MM / cell_mm)), round(_PART * rows)
    step = max(1, size * now.shape[1] // _SAMPLES)
    own, earlier, unchanged = (one[:, ::step] for one in (now, last, still))
    moved, in_place = [0], 0
    for start in _STARTS:
        part = slice(round(start * rows), round(start * rows) + size)
        moves = range(-reach, reach + 1)
        fits = np.array([_alike(own, earlier, unchanged, part, by) for by in moves])
        best, at = float(fits.max()), int(fits.argmax()) - reach
        if best < _ALIKE:
            continue
        far = np.abs(np.arange(-reach, reach + 1) - at) > least
        single = not far.any() or float(fits[far].max()) < _SINGLE * best
        in_place += abs(at) <= 1 and single
        if abs(at) >= least and single and fits[reach] < _AS_MUCH * best:
            moved.append(at)
    return Slid(max(moved, key=abs), in_place >= _CHECKED)


def _alike(now: FloatImage, last: FloatImage, still: BoolArray, part: slice, by: int) -> float:
    """Correlation of a part's rows with those moved ``by`` rows of the earlier map; 0 for few."""
    low, high = max(part.start, -by), min(part.stop, len(now), len(last) - by)
    if high <= low:
        return 0.0
    own, earlier = now[low:high], last[low + by : high + by]
    use = still[low + by : high + by] & np.isfinite(own) & np.isfinite(earlier)
    if use.sum() < _FEWEST:
        return 0.0
    a, b = own[use], earlier[use]
    a, b = a - a.mean(), b - b.mean()
    return float((a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-12))
