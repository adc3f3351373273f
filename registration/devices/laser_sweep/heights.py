"""Lay the points of a laser's sweep into a height map."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.devices.laser_sweep.planes import LaserSweep
from registration.devices.laser_sweep.profiles import Profile, Traced
from registration.errors import PictureError
from registration.files.readers.heights import HeightMap

_WIDER: Final = 1.2
"""Cells over the usual way from line to line, which varies."""
_MOST_MM: Final = 30.0
"""Above and below the flat face: what lies farther off is no ink."""
_CONTRADICTION_MM: Final = 0.5
"""Heights of one cell that differ by more: one of them is of a reflected line."""


def sweep_heights(
    traced: Traced, laser: LaserSweep, low_mm: FloatArray, high_mm: FloatArray
) -> HeightMap:
    """Return heights z of what a sweep lit within a rectangle, printer's frame.

    Cells are as wide as a pixel, or as the lines lie apart where that is more; each is the mean of
    its points, NaN without any.

    Parameters
    ----------
    traced : Traced
    laser : LaserSweep
    low_mm, high_mm : (2,) float64, mm

    Raises
    ------
    PictureError
        When no line lies there.
    """
    points = np.concatenate([_points(one, laser) for one in traced.profiles])
    inside = ((points[:, :2] >= low_mm) & (points[:, :2] <= high_mm)).all(axis=1)
    points = points[inside & (np.abs(points[:, 2] - laser.flat_z_mm) < _MOST_MM)]
    side = max(1e-3 * laser.frame.um_per_px, _WIDER * _spacing_mm(traced, low_mm, high_mm))
    columns, rows = (np.ceil((high_mm - low_mm) / side).astype(int) + 1).tolist()
    if not len(points):
        raise PictureError(
            "the laser's line lit nothing where the lines lie; sweep over the whole print"
        )
    cell = np.rint((points[:, :2] - low_mm) / side).astype(np.int64)
    at = cell[:, 1] * columns + cell[:, 0]
    count = np.bincount(at, minlength=rows * columns)
    total = np.bincount(at, points[:, 2], minlength=rows * columns)
    lowest, highest = np.full(rows * columns, np.inf), np.full(rows * columns, -np.inf)
    np.minimum.at(lowest, at, points[:, 2])
    np.maximum.at(highest, at, points[:, 2])
    count[highest - lowest > _CONTRADICTION_MM] = 0
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, columns)
    origin = (float(low_mm[0]), float(low_mm[1]))
    return HeightMap(mean.astype(np.float32), (side, side), origin, placed=True)


def _points(profile: Profile, laser: LaserSweep) -> FloatArray:
    """Places (n, 3) mm of a picture's line in the dish."""
    eye = np.array(laser.frame.eye_mm)
    z = laser.heights(profile.ends, profile.slopes)
    return np.column_stack([eye[:2] + (z - eye[2])[:, None] * profile.slopes, z])


def _spacing_mm(traced: Traced, low_mm: FloatArray, high_mm: FloatArray) -> float:
    """Usual way from line to line on the insert's plane, at the rectangle's middle, mm."""
    ends = np.array([one.ends[:, :2] for one in traced.profiles])
    way = ends[:, 1] - ends[:, 0]
    way *= np.where(way @ way[0] < 0, -1.0, 1.0)[:, None]
    across = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1)[:, None]
    off = np.sort(((ends[:, 0] - 0.5 * (low_mm + high_mm)) * across).sum(axis=1))
    steps = np.diff(off)
    moved = steps[steps > 1e-3]  # a laser that stood still tells one line twice
    return float(np.median(moved)) if len(moved) else 0.0
