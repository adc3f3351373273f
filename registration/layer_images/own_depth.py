"""Make a picture of filaments from an OCT volume: scattering at each filament's own depth.

One slab over all depths holds more bath than ink where filaments lead up or down, or lie at several
heights. Here each column of the volume is averaged over the height of the filament next to it as
seen from above, relative to what the whole volume usually sends back from that depth.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import siegelslopes

from registration.layer_images.height import (
    FLOOR,
    HeightFrame,
    depth_of,
    slab_mean,
    speckle_less,
)
from registration.layer_images.unmeasured import unmeasured_scans
from registration.layer_images.values import ExpectedLines, FloatArray, FloatImage
from registration.scan import Scan

_STEP_MM: Final = 0.05
_LEAST_HALF: Final = 1.0
"""Voxels of depth to either side."""
_HEIGHT: Final = 0.7
"""Of a round filament's width, over which it is averaged: beyond, its sides are bath."""
_LEAST_FLOOR: Final = 0.05
"""Of what the bath sends back, below which nothing is told apart."""
_BRIGHT: Final = 4.0
"""Times the bath, from which on ink tells how light fades with depth."""
_FEWEST: Final = 20
"""Places by which that is known."""
_MOST: Final = 400
"""And about as many are enough."""


def filament_map(scan: Scan, frame: HeightFrame, lines: ExpectedLines) -> FloatImage:
    """Return a picture (rows, columns, 1) for `see_layer`: logarithm, by the usual at that depth.

    Parameters
    ----------
    scan : Scan
    frame : HeightFrame
        As `height_map` returns it.
    lines : ExpectedLines
        Those written last (``fresh``) are followed.
    """
    unmeasured = unmeasured_scans(scan.volume)
    volume = speckle_less(scan.volume, scan.scale, unmeasured)
    usual = np.array([np.median(one[~unmeasured]) for one in volume]) if volume.size else 1.0
    volume /= np.maximum(usual, 1e-6 * float(np.max(usual)) + 1e-12)[:, None, None].astype("f4")
    place, width = _places(lines)
    column, row = np.meshgrid(np.arange(volume.shape[2]), np.arange(volume.shape[1]))
    at = np.column_stack([column.ravel(), row.ravel()])
    near = cKDTree(frame.to_pixels(place)).query(at)[1].reshape(column.shape)
    level = depth_of(frame, place[near, 2], volume.shape)
    half = 0.5 * _HEIGHT * width[near] * abs(float(frame.matrix[2, 2]))
    slab = slab_mean(volume, level, np.maximum(half, _LEAST_HALF))
    slab[unmeasured] = np.nan
    floor = np.float32(FLOOR) * _ink_level(slab, level, frame.to_pixels(place))
    floor = np.maximum(floor, np.float32(_LEAST_FLOOR))
    return np.log((slab + floor) / (1 + floor))[:, :, None]


def _ink_level(slab: FloatImage, level: FloatArray, at: FloatArray) -> FloatImage:
    """What bright ink sends back from the depth ``level`` of each column, times the bath.

    A logarithm without a floor makes the blurred rim of such ink as wide as the ink itself.
    """
    column, row = np.rint(at).astype(np.int64).T
    inside = (row >= 0) & (row < slab.shape[0]) & (column >= 0) & (column < slab.shape[1])
    row, column = row[inside], column[inside]
    bright = slab[row, column] > _BRIGHT
    row, column = row[bright], column[bright]
    if len(row) < _FEWEST:
        return np.zeros_like(slab)
    ink, depth = np.log(slab[row, column]), level[row, column]
    few = slice(None, None, 1 + len(row) // _MOST)
    fade = siegelslopes(ink[few], depth[few]) if np.ptp(depth[few]) > 2.0 else None
    slope, begin = (fade.slope, fade.intercept) if fade else (0.0, float(np.median(ink)))
    known = np.clip(level, depth.min(), depth.max())
    return np.exp(begin + slope * known).astype(np.float32)


def _places(lines: ExpectedLines) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) along fresh lines, mm, and their widths, (n,)."""
    rows = np.flatnonzero(lines.fresh)
    length = np.linalg.norm((lines.end - lines.start)[rows], axis=1)
    count = np.maximum(2, np.ceil(length / _STEP_MM).astype(np.int64) + 1)
    own = np.repeat(rows, count)
    number = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
    share = (number / np.repeat(count - 1, count))[:, None]
    return lines.start[own] * (1 - share) + lines.end[own] * share, lines.width_mm[own]
