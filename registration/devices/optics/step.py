"""Measure the optical path between the two levels of a scanned step, for depth calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.optics.columns import columns_of
from registration.errors import SegmentationError
from registration.scan import Scan

_CLEAR_DB = 10.0
_ROUNDS = 50
_LEAST_SHARE = 0.1


@dataclass(frozen=True)
class Step:
    """Two parallel levels, measured.

    Attributes
    ----------
    path_mm : float, mm
        Optical path between them, square to the levels.
    error_mm : float, mm
        Standard error of it.
    scatter_mm : float, mm
        Standard deviation of the columns about the two planes.
    tilt_deg : float, degrees
        Of the levels.
    """

    path_mm: float
    error_mm: float
    scatter_mm: float
    tilt_deg: float


def measure_step(scan: Scan) -> Step:
    """Measure the path between two flat levels that fill the view.

    Two planes of one slope are fitted to the brightest reflection of every column, each column
    to the nearer plane. With the slope s (in paths) and the gap g along z the path square to the
    levels is g / √(1 + s²). Neighbouring columns share speckle, so the standard error counts one
    column in nine.

    Raises
    ------
    SegmentationError
        When there aren't two clear levels.
    """
    seen = columns_of(scan)
    clear = seen.peak_db - seen.floor_db > _CLEAR_DB
    y, x = np.meshgrid(seen.y_mm, seen.x_mm, indexing="ij")
    if clear.mean() < _LEAST_SHARE:
        raise SegmentationError(
            f"{scan.came_from}: {100 * clear.mean():.0f} % of the columns show a clear reflection "
            f"(needed: {100 * _LEAST_SHARE:.0f} %); focus on the step"
        )
    x, y, depth = x[clear] - x.mean(), y[clear] - y.mean(), seen.depth_mm[clear]
    planes, lower = _two_planes(x, y, depth)
    gap, slope = float(planes[1] - planes[0]), math.hypot(*planes[2:])
    off = depth - _at(planes, x, y, lower)
    near = np.abs(off) < 3 * 1.4826 * np.median(np.abs(off)) + 1e-9
    scatter = float(off[near].std())
    share = float(lower.mean())
    if not _LEAST_SHARE < share < 1 - _LEAST_SHARE or gap < 6 * scatter:
        raise SegmentationError(
            f"{scan.came_from}: shows no step: {100 * share:.0f} % of it on the lower level, "
            f"{1e3 * gap:.0f} µm below, columns scatter by {1e3 * scatter:.0f} µm; bring both "
            "levels into the view"
        )
    square = 1 / math.sqrt(1 + slope**2)
    count = max(1.0, len(x) / 9)
    error = scatter * math.sqrt(1 / (count * share) + 1 / (count * (1 - share)))
    return Step(gap * square, error * square, scatter, math.degrees(math.atan(slope)))


def _two_planes(
    x: FloatArray, y: FloatArray, depth: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Upper and lower depth in the middle, slopes along x and y; and which points lie lower."""
    best, spread = None, math.inf
    # From a few slopes: a tilt may be larger than the step.
    for tilt_x in np.linspace(-0.1, 0.1, 5):
        for tilt_y in np.linspace(-0.1, 0.1, 5):
            planes, lower = _refined(x, y, depth, tilt_x, tilt_y)
            now = float(np.median(np.abs(depth - _at(planes, x, y, lower))))
            if now < spread:
                best, spread = (planes, lower), now
    if best is None:
        raise SegmentationError("no step was found; bring both levels into the view")
    return best


def _refined(
    x: FloatArray, y: FloatArray, depth: FloatArray, tilt_x: float, tilt_y: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    level = depth - tilt_x * x - tilt_y * y
    low, high = np.percentile(level, (5, 95))
    lower = level > (low + high) / 2
    planes = np.array([low, high, tilt_x, tilt_y])
    for _ in range(_ROUNDS):
        basis = np.column_stack([~lower, lower, x, y]).astype(np.float64)
        off = np.abs(depth - _at(planes, x, y, lower))
        keep = off <= np.percentile(off, 95)
        planes = np.linalg.lstsq(basis[keep], depth[keep])[0]
        level = depth - planes[2] * x - planes[3] * y
        again = level > (planes[0] + planes[1]) / 2
        if (again == lower).all():
            break
        lower = again
    return planes, lower


def _at(planes: FloatArray, x: FloatArray, y: FloatArray, lower: NDArray[np.bool_]) -> FloatArray:
    return np.where(lower, planes[1], planes[0]) + planes[2] * x + planes[3] * y
