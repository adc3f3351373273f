"""Make a picture of filaments from an OCT volume: scattering at each filament's own depth.

One slab over all depths holds more bath than ink where filaments lead up or down, or lie at several
heights. Here each column of the volume is averaged over the height of the filament next to it as
seen from above, relative to what the whole volume usually sends back from that depth.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from registration.layer_images.height import (
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


def filament_map(scan: Scan, frame: HeightFrame, lines: ExpectedLines) -> FloatImage:
    """Return a picture (rows, columns, 1) for `see_layer`: logarithm of the usual at that depth.

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
    return np.log(slab + np.float32(0.05))[:, :, None]


def _places(lines: ExpectedLines) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) along fresh lines, mm, and their widths, (n,)."""
    rows = np.flatnonzero(lines.fresh)
    length = np.linalg.norm((lines.end - lines.start)[rows], axis=1)
    count = np.maximum(2, np.ceil(length / _STEP_MM).astype(np.int64) + 1)
    own = np.repeat(rows, count)
    number = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
    share = (number / np.repeat(count - 1, count))[:, None]
    return lines.start[own] * (1 - share) + lines.end[own] * share, lines.width_mm[own]
