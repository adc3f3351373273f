"""Find the brightest reflection in each A-scan of an OCT scan, and its depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.scan import Scan

_B_SCANS = 32


@dataclass(frozen=True)
class Columns:
    """A picture from above.

    Attributes
    ----------
    x_mm, y_mm : (nx,), (ny,) float64, mm
        Where the columns stand in the scan's frame.
    depth_mm : (ny, nx) float64, mm
        Optical depth of the brightest reflection, to a fraction of a voxel.
    peak_db, floor_db : (ny, nx) float64, dB
        Brightness there, and the column's median.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    depth_mm: FloatArray
    peak_db: FloatArray
    floor_db: FloatArray


def columns_of(scan: Scan) -> Columns:
    """Look down every A-scan of a volume.

    The depth is a parabola's peak through the logarithm of the brightest voxel and its two
    neighbours: exact for a Gaussian point spread.
    """
    ny, nx = scan.volume.shape[1:]
    depth, peak, floor = (np.empty((ny, nx)) for _ in range(3))
    for first in range(0, ny, _B_SCANS):
        part = slice(first, first + _B_SCANS)
        values = in_decibels(scan, part)
        at = np.clip(np.argmax(values, axis=0), 1, len(values) - 2)
        low, top, high = (
            np.take_along_axis(values, (at + step)[None], axis=0)[0] for step in (-1, 0, 1)
        )
        bend = low - 2 * top + high
        offset = np.where(bend < 0, (low - high) / np.where(bend < 0, 2 * bend, 1.0), 0.0)
        depth[part] = at + np.clip(offset, -0.5, 0.5)
        peak[part] = top
        floor[part] = np.median(values, axis=0)
    dz, dy, dx = scan.voxel_mm
    x, y = (np.arange(n, dtype=np.float64) * size for n, size in ((nx, dx), (ny, dy)))
    return Columns(x, y, depth * dz * path_per_depth(scan), peak, floor)


def path_per_depth(scan: Scan) -> float:
    """Optical path for a mm of the scan's own depth."""
    return 1.0 if scan.optical_depth else scan.refractive_index


def in_decibels(scan: Scan, part: slice) -> FloatArray:
    """B-scans of a scan in dB, as z (downwards), y, x."""
    values = scan.volume[:: 1 if scan.depth_down else -1, part].astype(np.float64)
    if scan.scale == "db":
        return values
    positive = values[values > 0]
    least = float(positive.min()) if positive.size else 1.0
    return np.asarray(10 * np.log10(np.maximum(values, least)))
