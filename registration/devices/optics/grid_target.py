"""Find the dots of a square-lattice calibration target in a scan, with row and column of each."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from skimage.measure import label, regionprops
from skimage.segmentation import clear_border

from kernels.arrays import FloatArray, IntArray
from registration.devices.optics.columns import Columns, columns_of
from registration.errors import SegmentationError
from registration.scan import Scan

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
