"""Triangles of a file that pass through one another, by means that the product doesn't use.

Triangles are sorted along a Z-order curve of their middles and boxed in runs of eight, pairs of
which are boxed again up to one box (the product: median splits). Each edge is shot at each
triangle of a box that it meets (Möller & Trumbore 1997, doi 10.1080/10867651.1997.10487468; the
product: signs of tetrahedra with an error bound). What passes within a millionth of an edge's or a
triangle's own length of a rim isn't counted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RUN = 8
_WITHIN = 1e-6


def crossing_triangles(corners: FloatArray) -> int:
    """How many pairs of triangles (f, 3, 3) cross, equal corners being one point."""
    order = np.argsort(_along_curve(corners.mean(axis=1)), kind="stable")
    sorted_corners = np.ascontiguousarray(corners[order])
    low, high = sorted_corners.min(axis=1), sorted_corners.max(axis=1)
    levels = [_boxed(low, high, _RUN)]
    while len(levels[-1][0]) > 1:
        levels.append(_boxed(*levels[-1], 2))
    begin = np.cumsum([0, *(len(box[0]) for box in levels)])
    return int(
        _count(
            sorted_corners,
            low,
            high,
            np.concatenate([box[0] for box in levels]),
            np.concatenate([box[1] for box in levels]),
            begin,
        )
    )


def _along_curve(points: FloatArray) -> IntArray:
    """Place of each point along a Z-order curve of 2^20 cells a side."""
    low = points.min(axis=0)
    span = float((points.max(axis=0) - low).max()) or 1.0
    cell = ((points - low) / span * (2**20 - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(20):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _boxed(low: FloatArray, high: FloatArray, run: int) -> tuple[FloatArray, FloatArray]:
    starts = np.arange(0, len(low), run)
    return np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)


@compiled
def _count(
    corners: FloatArray,
    least: FloatArray,
    most: FloatArray,
    low: FloatArray,
    high: FloatArray,
    begin: IntArray,
) -> int:
    found = 0
    top_level = len(begin) - 2
    stack = np.empty((256, 2), np.int64)
    for n in range(len(corners)):
        stack[0, 0], stack[0, 1] = top_level, 0
        size = 1
        while size > 0:
            size -= 1
            level, index = stack[size, 0], stack[size, 1]
            box = begin[level] + index
            meets = True
            for axis in range(3):
                if least[n, axis] > high[box, axis] or most[n, axis] < low[box, axis]:
                    meets = False
            if not meets:
                continue
            if level > 0:
                for child in (2 * index, 2 * index + 1):
                    if child < begin[level] - begin[level - 1]:
                        stack[size, 0], stack[size, 1] = level - 1, child
                        size += 1
                continue
            for m in range(_RUN * index, min(_RUN * (index + 1), len(corners))):
                apart = m <= n
                for axis in range(3):
                    if least[n, axis] > most[m, axis] or most[n, axis] < least[m, axis]:
                        apart = True
                if not apart and _cross(corners[n], corners[m]):
                    found += 1
    return found


@compiled
def _cross(one: FloatArray, two: FloatArray) -> bool:
    for turn in range(2):
        edges, triangle = (one, two) if turn == 0 else (two, one)
        for i in range(3):
            p, q = edges[i], edges[(i + 1) % 3]
            if not (_is_corner(p, triangle) or _is_corner(q, triangle)) and _shot(p, q, triangle):
                return True
    return False


@compiled
def _is_corner(point: FloatArray, triangle: FloatArray) -> bool:
    for k in range(3):
        same = True
        for axis in range(3):
            same = same and point[axis] == triangle[k, axis]
        if same:
            return True
    return False


@compiled
def _shot(p: FloatArray, q: FloatArray, triangle: FloatArray) -> bool:
    ax, ay, az = triangle[0, 0], triangle[0, 1], triangle[0, 2]
    wx, wy, wz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    ox, oy, oz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    ex, ey, ez = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    cx, cy, cz = wy * ez - wz * ey, wz * ex - wx * ez, wx * ey - wy * ex
    det = ox * cx + oy * cy + oz * cz
    nx, ny, nz = oy * ez - oz * ey, oz * ex - ox * ez, ox * ey - oy * ex
    size = (nx * nx + ny * ny + nz * nz) * (wx * wx + wy * wy + wz * wz)
    if det * det <= 1e-18 * size:
        return False
    tx, ty, tz = p[0] - ax, p[1] - ay, p[2] - az
    u = (tx * cx + ty * cy + tz * cz) / det
    if u <= _WITHIN or u >= 1.0 - _WITHIN:
        return False
    rx, ry, rz = ty * oz - tz * oy, tz * ox - tx * oz, tx * oy - ty * ox
    v = (wx * rx + wy * ry + wz * rz) / det
    t = (ex * rx + ey * ry + ez * rz) / det
    return bool(min(v, min(1.0 - u - v, min(t, 1.0 - t))) > _WITHIN)
