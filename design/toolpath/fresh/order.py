"""Order a layer's paths for short travels: walls from each contour inward, then infill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.toolpath.fresh.order_lines import order_lines
from design.toolpath.fresh.paths import Paths, Role
from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray

#: Beginning a larger ring elsewhere than near by costs more way than it is worth.
SMALL_RING_MM = 3.0


@dataclass(frozen=True)
class Sequence:
    """Paths in the order of writing.

    Attributes
    ----------
    path : (m,) int64
        Numbers of the paths.
    first : (m,) int64
        Point, in `Paths.points`, at which each begins.
    backward : (m,) bool
        Whether it is written from its end to its begin.
    """

    path: IntArray
    first: IntArray
    backward: BoolArray

    def then(self, other: Sequence) -> Sequence:
        """Both, one after the other."""
        return Sequence(
            np.concatenate([self.path, other.path]),
            np.concatenate([self.first, other.first]),
            np.concatenate([self.backward, other.backward]),
        )


def order_paths(paths: Paths, at: FloatArray, link_mm: float, seam_rad: float = 0.0) -> Sequence:
    """Walls and gaps first, each lumen's from the inside out; then the infill.

    Parameters
    ----------
    paths : Paths
    at : (2,) float64, mm
        Where the needle is.
    link_mm : float, mm
        Infill lines no further apart than this are written in one go.
    seam_rad : float, rad
        Where on small rings along the boundary, seen from their middle, writing begins. The begin
        of a line is its weakest place; it should differ from layer to layer.
    """
    outline = np.flatnonzero(paths.role != Role.INFILL)
    lines = np.flatnonzero(paths.role == Role.INFILL)
    done = _outlines(paths, outline, at, seam_rad)
    if len(outline):
        last, backward = done.path[-1], done.backward[-1]
        ends = paths.offset[last] if backward else paths.offset[last + 1] - 1
        at = paths.points[done.first[-1] if paths.closed[last] else ends]
    start = paths.points[paths.offset[lines]]
    end = paths.points[paths.offset[lines + 1] - 1]
    order, flipped = order_lines(start, end, at, link_mm)
    path, turned = lines[order], flipped[order]
    first = np.where(turned, paths.offset[path + 1] - 1, paths.offset[path])
    return done.then(Sequence(path, first, turned))


def _outlines(paths: Paths, which: IntArray, at: FloatArray, seam_rad: float) -> Sequence:
    """Nearest neighbour, a wall not before the wall between it and the boundary."""
    low = np.minimum.reduceat(paths.points, paths.offset[:-1])
    high = np.maximum.reduceat(paths.points, paths.offset[:-1])
    towards = np.array([np.cos(seam_rad), np.sin(seam_rad)])
    path, first, backward = _nearest_outlines(
        paths.points,
        paths.offset,
        paths.closed,
        _outer(paths, which, low, high),
        which,
        low,
        high,
        at,
        towards,
    )
    return Sequence(path, first, backward)


def _outer(paths: Paths, which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
    """The wall that must be written before each path; -1 for none."""
    before = np.full(len(paths), -1, dtype=np.int64)
    walls = which[paths.role[which] == Role.WALL]
    for level in range(1, int(paths.level[walls].max(initial=0)) + 1):
        outer = walls[paths.level[walls] == level - 1]
        inner = walls[paths.level[walls] == level]
        if len(outer) and len(inner):
            starts = paths.points[paths.offset[inner]]
            before[inner] = _nearest_paths(starts, outer, paths.points, paths.offset, low, high)
    return before


@jit
def _box_gap(x: float, y: float, low: FloatArray, high: FloatArray) -> float:
    dx, dy = max(low[0] - x, 0.0, x - high[0]), max(low[1] - y, 0.0, y - high[1])
    return dx * dx + dy * dy


@jit
def _nearest_paths(
    at: FloatArray,
    which: IntArray,
    points: FloatArray,
    offset: IntArray,
    low: FloatArray,
    high: FloatArray,
) -> IntArray:
    """Path of ``which`` that has the point nearest to each of ``at``."""
    nearest = np.empty(len(at), np.int64)
    for j in range(len(at)):
        x, y, best = at[j, 0], at[j, 1], np.inf
        for k in which:
            if _box_gap(x, y, low[k], high[k]) >= best:
                continue
            for i in range(offset[k], offset[k + 1]):
                gap = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                if gap < best:
                    best, nearest[j] = gap, k
    return nearest


@jit
def _nearest_outlines(
    points: FloatArray,
    offset: IntArray,
    closed: BoolArray,
    before: IntArray,
    which: IntArray,
    low: FloatArray,
    high: FloatArray,
    at: FloatArray,
    towards: FloatArray,
) -> tuple[IntArray, IntArray, BoolArray]:
    count = len(which)
    left = which.copy()
    done = np.zeros(len(closed), np.bool_)
    path, first = np.empty(count, np.int64), np.empty(count, np.int64)
    backward = np.zeros(count, np.bool_)
    x, y = at[0], at[1]
    for step in range(count):
        best, place, begin = np.inf, -1, 0
        for j in range(count - step):
            k = left[j]
            if before[k] >= 0 and not done[before[k]]:
                continue
            if _box_gap(x, y, low[k], high[k]) >= best:
                continue
            last = offset[k + 1] - 1
            stride = 1 if closed[k] else max(last - offset[k], 1)
            for i in range(offset[k], last + 1, stride):
                gap = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                if gap < best:
                    best, place, begin = gap, j, i
        k = left[place]
        left[place] = left[count - step - 1]
        done[k] = True
        if closed[k] and before[k] < 0 and max(high[k] - low[k]) <= SMALL_RING_MM:
            most = -np.inf
            for i in range(offset[k], offset[k + 1]):
                far = points[i, 0] * towards[0] + points[i, 1] * towards[1]
                if far > most:
                    most, begin = far, i
        path[step], first[step] = k, begin
        at_end = not closed[k] and begin == offset[k + 1] - 1 and begin > offset[k]
        backward[step] = at_end
        stop = begin if closed[k] else (offset[k] if at_end else offset[k + 1] - 1)
        x, y = points[stop, 0], points[stop, 1]
    return path, first, backward
