"""Tell lines across which the pattern of older ink still shows as it did before they were due.

A bare stretch beside fresh lines changes, too: they shade it and light it anew. But the ridges of
the older lines that cross it stay where they were, and fresh ink covers or bends them. So the two
pictures are correlated along each line, in its middle and without what varies slowly, and compared
with lines of its direction. Lines along older ones look like them anyway, and tell nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.pictures.working import Working
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways, stretches_of

_ACROSS: Final = np.linspace(-0.36, 0.36, 9)
"""Of a width: beyond it lies the shade of lines beside."""
_WINDOW: Final = 4.0
"""Widths along a line, whose pictures are correlated."""
_SLOW: Final = 0.6
"""Widths: what varies over more is light."""
_NEAR: Final = 0.35
"""Widths from a line's middle, within which an older one lies below it."""
_PARALLEL: Final = 0.9
"""Cosine of the angle between lines of one direction."""
_DIRECTIONS: Final = 6
_LEAST_MM, _LINES = 6.0, 3
"""Way of a direction, and straight parts of paths, fewer of which tell nothing."""
_SPREADS, _MORE, _LEAST = 4.0, 0.2, 0.35
"""A stretch is told above the usual correlation by so many spreads and so much, and above the last
(in a stranger's 30 sound looks 1.2 mm at most)."""
_QUARTILE: Final = 0.6745
"""Standard deviations below the middle."""
_SHORTEST_MM: Final = 1.5


def only_crossed(ways: Ways, older: Ways) -> BoolArray:
    """Places below which no older line runs along their own, (n,)."""
    reach = _NEAR * float(np.median(ways.width))
    pairs = cKDTree(ways.point[:, :2]).sparse_distance_matrix(
        cKDTree(older.point[:, :2]), reach, output_type="ndarray"
    )
    turned = (ways.normal[pairs["i"]] * older.normal[pairs["j"]]).sum(axis=1)
    out = np.ones(len(ways), dtype=np.bool_)
    out[pairs["i"][np.abs(turned) > _PARALLEL]] = False
    return out


def older_pattern_shows(work: Working, ways: Ways, seen: Seen, crossed: BoolArray) -> BoolArray:
    """Places of stretches across which it does, (n,), of those that are ``crossed`` alone."""
    out = np.zeros(len(ways), dtype=np.bool_)
    if work.earlier is None or not crossed.any():
        return out
    alike = _correlation(work, ways, seen)
    for rows in _kinds(ways, crossed & np.isfinite(alike)):
        usual, low = np.percentile(alike[rows], [50.0, 25.0])
        more = max(_SPREADS * (usual - low) / _QUARTILE, _MORE)
        shows = rows & (alike > max(usual + more, _LEAST))
        for first, last in stretches_of(shows, ways.run):
            own = slice(first, last + 1)
            out[own] = ways.step[own].sum() > _SHORTEST_MM
    return out


def _correlation(work: Working, ways: Ways, seen: Seen) -> FloatArray:
    """Correlation of both pictures in a window around each place, (n,); NaN where one is even."""
    assert work.earlier is not None
    count = work.earlier.shape[2]
    size = _SLOW * float(np.median(ways.width)) * work.px_per_mm
    now, before = (
        seen.profiles(_without_slow(image, size), ways.width[:, None] * _ACROSS).astype(np.float64)
        for image in (work.channels[:, :, :count], work.earlier)
    )
    window = max(1, round(_WINDOW * float(np.median(ways.width / ways.step)))) | 1

    def mean(values: FloatArray) -> FloatArray:
        across, out = values.mean(axis=1), np.empty(len(values))
        for run in np.unique(ways.run):
            own = np.flatnonzero(ways.run == run)
            out[own] = uniform_filter1d(across[own], min(window, len(own)), mode="nearest")
        return out

    both = mean(now * before) - mean(now) * mean(before)
    each = [mean(one * one) - mean(one) ** 2 for one in (now, before)]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(
            np.where(np.minimum(*each) > 0, both / np.sqrt(each[0] * each[1]), np.nan)
        )


def _without_slow(image: FloatImage, sigma_px: float) -> FloatImage:
    bright = np.ascontiguousarray(image.mean(axis=2), dtype=np.float32)
    return np.asarray(bright - cv2.GaussianBlur(bright, (0, 0), sigma_px))


def _kinds(ways: Ways, rows: BoolArray) -> Iterator[BoolArray]:
    """Yield rows of one direction, of enough lines, (n,) each."""
    turned = (ways.normal[1:] * ways.normal[:-1]).sum(axis=1) < _PARALLEL
    line = np.cumsum(np.append(False, turned | (np.diff(ways.run) != 0)))
    angle = np.arctan2(ways.normal[:, 1], ways.normal[:, 0])
    part = np.round(angle / np.pi * _DIRECTIONS).astype(int) % _DIRECTIONS
    for one in np.unique(part[rows]):
        own = rows & (part == one)
        if ways.step[own].sum() > _LEAST_MM and len(np.unique(line[own])) >= _LINES:
            yield own
