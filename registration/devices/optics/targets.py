"""Find calibration targets in an OCT scan: brightest reflections, dot grid, step."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from skimage.measure import label, regionprops
from skimage.segmentation import clear_border

from kernels.arrays import FloatArray, IntArray
from registration.errors import SegmentationError
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


_CLEAR_DB = 10.0
_FEWEST = 25
_NEAR = 0.25
_AROUND = 1.5


@dataclass(frozen=True)
class GridView:
    """One scan of the target.

    Attributes
    ----------
    points : (n, 3) float64, mm
        Centres of dots in the scan's frame, z the optical path.
    index : (n, 2) int64
        Column and row of each on the target, from an arbitrary one.
    middle_mm : (2,) float64, mm
        Middle of the field.
    """

    points: FloatArray
    index: IntArray
    middle_mm: FloatArray


def find_grid(scan: Scan, pitch_mm: float) -> GridView:
    """Find the dots of a target, dark on bright or bright on dark, and their places on it.

    Raises
    ------
    SegmentationError
        When fewer than 25 dots form a lattice of that pitch.
    """
    seen = columns_of(scan)
    step = np.array([seen.x_mm[1], seen.y_mm[1]])
    flat = _flattened(seen, pitch_mm, step)
    centres = _centres(flat)
    if len(centres) < _FEWEST:
        raise SegmentationError(
            f"{scan.came_from}: shows {len(centres)} dots (needed: {_FEWEST}); focus on the "
            "target and bring more of it into the view"
        )
    places = centres * step
    index, indexed = _indexed(places, pitch_mm)
    if indexed.sum() < _FEWEST:
        raise SegmentationError(
            f"{scan.came_from}: {indexed.sum()} of {len(places)} dots lie on a square lattice of "
            f"{1e3 * pitch_mm:g} µm (needed: {_FEWEST}); check --pitch-um and the voxel size"
        )
    depth = _depth_at(seen, centres[indexed], pitch_mm, step)
    middle = np.array([seen.x_mm[-1], seen.y_mm[-1]]) / 2
    return GridView(np.column_stack([places[indexed], depth]), index[indexed], middle)


def _flattened(seen: Columns, pitch_mm: float, step: FloatArray) -> FloatArray:
    """Brightness less its surroundings, dots positive, a little smoothed."""
    wide = _AROUND * pitch_mm / step[::-1]
    narrow = 0.05 * pitch_mm / step[::-1]
    flat = gaussian_filter(seen.peak_db, narrow) - gaussian_filter(seen.peak_db, wide)
    low, high = np.percentile(flat, (1, 99))
    flat -= (low + high) / 2
    # Dots cover less of the target than what lies between them.
    return -flat if (flat > 0).mean() > 0.5 else flat


def _centres(flat: FloatArray) -> FloatArray:
    """Weighted centres (x, y, in voxels) of whole dots of about the usual size."""
    dots = regionprops(clear_border(label(flat > 0, connectivity=1)), np.maximum(flat, 0))
    usual = np.median([dot.area for dot in dots if dot.area > 4] or [0.0])
    kept = [dot.centroid_weighted for dot in dots if usual / 3 < dot.area < 3 * usual]
    return np.array(kept).reshape(-1, 2)[:, ::-1]


def _indexed(places: FloatArray, pitch_mm: float) -> tuple[IntArray, NDArray[np.bool_]]:
    """Column and row of each dot, spread from the middlemost along the lattice."""
    tree = cKDTree(places)
    first = int(tree.query(places.mean(axis=0))[1])
    ways = _ways(places[tree.query_ball_point(places[first], 1.3 * pitch_mm)] - places[first])
    index = np.zeros((len(places), 2), dtype=np.int64)
    reached = np.zeros(len(places), dtype=bool)
    if ways is None:
        return index, reached
    reached[first], queue = True, deque([first])
    while queue:
        here = queue.popleft()
        for way, turn in zip(ways, ((1, 0), (-1, 0), (0, 1), (0, -1)), strict=True):
            off, there = tree.query(places[here] + way)
            if off < _NEAR * pitch_mm and not reached[there]:
                reached[there], index[there] = True, index[here] + turn
                queue.append(int(there))
    return index, reached


def _ways(near: FloatArray) -> FloatArray | None:
    """Steps to the neighbours: most along +x, and a quarter turn from it; and back."""
    far = near[np.hypot(*near.T) > 0]
    if len(far) < 2:
        return None
    east = far[np.argmax(far[:, 0] / np.hypot(*far.T))]
    north = np.array([-east[1], east[0]])
    nearest = far[np.argmin(np.hypot(*(far - north).T))]
    if np.hypot(*(nearest - north)) > _NEAR * np.hypot(*north):
        return None
    return np.array([east, -east, nearest, -nearest])


def _depth_at(seen: Columns, centres: FloatArray, pitch_mm: float, step: FloatArray) -> FloatArray:
    """Mean depth of clear columns around each dot."""
    clear = (seen.peak_db - seen.floor_db > _CLEAR_DB).astype(np.float64)
    wide = 0.25 * pitch_mm / step[::-1]
    weight = gaussian_filter(clear, wide)
    mean = gaussian_filter(clear * seen.depth_mm, wide) / np.maximum(weight, 1e-9)
    x, y = np.round(centres).astype(int).T
    return np.asarray(mean[y, x])


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
