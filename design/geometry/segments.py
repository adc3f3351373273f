"""Distances of points, segments and triangles (Ericson, Real-Time Collision Detection, 5.1)."""

from __future__ import annotations

from math import sqrt
from typing import Any, Final

import numpy as np

from kernels import jit, scalar_jit
from kernels.arrays import FloatArray, IntArray


@jit
def point_segment(
    px: float,
    py: float,
    pz: float,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
) -> tuple[float, float]:
    """Distance of point p from segment ab, and where on it (0 at a, 1 at b).

    A segment of zero length counts as its first end.
    """
    ux, uy, uz = bx - ax, by - ay, bz - az
    length2 = ux * ux + uy * uy + uz * uz
    t = 0.0
    if length2 > 0.0:
        t = ((px - ax) * ux + (py - ay) * uy + (pz - az) * uz) / length2
        t = min(1.0, max(0.0, t))
    dx, dy, dz = ax + t * ux - px, ay + t * uy - py, az + t * uz - pz
    return sqrt(dx * dx + dy * dy + dz * dz), t


@jit
def segment_segment(
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    cx: float,
    cy: float,
    cz: float,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, float, float]:
    """Distance between segments ab and cd, and where on each (0 to 1) it is reached.

    Parallel and zero-length segments included; of several nearest places one is given.
    """
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = dx - cx, dy - cy, dz - cz
    wx, wy, wz = ax - cx, ay - cy, az - cz
    a = ux * ux + uy * uy + uz * uz
    e = vx * vx + vy * vy + vz * vz
    f = vx * wx + vy * wy + vz * wz
    s = 0.0
    t = 0.0
    if a <= 0.0:
        if e > 0.0:
            t = min(1.0, max(0.0, f / e))
    else:
        c = ux * wx + uy * wy + uz * wz
        if e <= 0.0:
            s = min(1.0, max(0.0, -c / a))
        else:
            b = ux * vx + uy * vy + uz * vz
            across = a * e - b * b
            # Below this the lines are parallel to rounding and any s serves.
            if across > 1e-14 * a * e:
                s = min(1.0, max(0.0, (b * f - c * e) / across))
            t = (b * s + f) / e
            if t < 0.0:
                t = 0.0
                s = min(1.0, max(0.0, -c / a))
            elif t > 1.0:
                t = 1.0
                s = min(1.0, max(0.0, (b - c) / a))
    gx = wx + s * ux - t * vx
    gy = wy + s * uy - t * vy
    gz = wz + s * uz - t * vz
    return sqrt(gx * gx + gy * gy + gz * gz), s, t


SLIVER: Final = 1e-14
"""Squared sine of a triangle's angle below which it counts as its edges: what it is beside them
is lost in rounding."""


@scalar_jit
def point_triangle_squared(px: float, py: float, pz: float, tri: Any) -> float:
    """Squared distance of point p from the triangle whose nine coordinates are ``tri`` (9,).

    One without an area counts as its edges, or as the point that it is.
    """
    ax, ay, az = tri[0], tri[1], tri[2]
    abx, aby, abz = tri[3] - ax, tri[4] - ay, tri[5] - az
    acx, acy, acz = tri[6] - ax, tri[7] - ay, tri[8] - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    v = 0.0
    w = 0.0
    if d1 > 0.0 or d2 > 0.0:
        bpx, bpy, bpz = px - tri[3], py - tri[4], pz - tri[5]
        d3 = abx * bpx + aby * bpy + abz * bpz
        d4 = acx * bpx + acy * bpy + acz * bpz
        cpx, cpy, cpz = px - tri[6], py - tri[7], pz - tri[8]
        d5 = abx * cpx + aby * cpy + abz * cpz
        d6 = acx * cpx + acy * cpy + acz * cpz
        vc = d1 * d4 - d3 * d2
        vb = d5 * d2 - d1 * d6
        va = d3 * d6 - d5 * d4
        if d3 >= 0.0 and d4 <= d3:
            v = 1.0
        elif d6 >= 0.0 and d5 <= d6:
            w = 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
            v = d1 / (d1 - d3)
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
            w = d2 / (d2 - d6)
        elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            v = 1.0 - w
        else:
            total = va + vb + vc
            if total <= SLIVER * (d1 - d3) * (d2 - d6):
                return _edges_squared(px, py, pz, tri)
            v = vb / total
            w = vc / total
    gx = apx - v * abx - w * acx
    gy = apy - v * aby - w * acy
    gz = apz - v * abz - w * acz
    return gx * gx + gy * gy + gz * gz


@scalar_jit
def _edges_squared(px: float, py: float, pz: float, tri: Any) -> float:
    best = np.inf
    for edge in range(3):
        i, j = 3 * edge, 3 * ((edge + 1) % 3)
        away, _ = point_segment(
            px, py, pz, tri[i], tri[i + 1], tri[i + 2], tri[j], tri[j + 1], tri[j + 2]
        )
        best = min(best, away)
    return best * best


_CELLS_PER_PIECE = 8


def close_pairs(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    nodes: IntArray,
    clearance_mm: float,
    clearance_ratio: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Pairs of pieces without a common node and with a gap below the clearance.

    Parameters
    ----------
    start, end : (n, 3) float64, mm
    radius : (n,) float64, mm
    nodes : (n, 2) int64
        At the two ends of each piece.
    clearance_mm, clearance_ratio : float
        See `design.vasculature.collide.collisions`.

    Returns
    -------
    pairs : (k, 2) int64
        Sorted.
    gap : (k,) float64, mm
    place : (k, 3) float64, mm
        Midway between the axes where these are nearest.
    """
    # Each piece is listed in all cells within its reach, so that two that are near share one.
    reach = radius + 0.5 * np.maximum(clearance_mm, clearance_ratio * radius)
    low, high = _bounds(start, end, reach)
    cell = _cell_size(start, end, reach, low, high)
    shape = np.maximum(1, np.ceil((high - low) / cell)).astype(np.int64)
    first, item = _list_pieces(start, end, reach, low, cell, shape)
    size = 1024
    while True:
        pairs = np.empty((size, 2), np.int64)
        values = np.empty((size, 4))
        count = _pairs_in_cells(
            first, item, start, end, radius, nodes, clearance_mm, clearance_ratio, pairs, values
        )
        if count <= size:
            break
        size = count
    order = np.lexsort((pairs[:count, 1], pairs[:count, 0]))
    pairs, values = pairs[order], values[order]
    fresh = np.ones(count, dtype=bool)
    fresh[1:] = (pairs[1:] != pairs[:-1]).any(axis=1)
    return pairs[fresh], values[fresh, 0], values[fresh, 1:]


def _bounds(start: FloatArray, end: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    low: FloatArray = (np.minimum(start, end) - reach[:, None]).min(axis=0)
    high: FloatArray = (np.maximum(start, end) + reach[:, None]).max(axis=0)
    return low, high


def _cell_size(
    start: FloatArray, end: FloatArray, reach: FloatArray, low: FloatArray, high: FloatArray
) -> float:
    """Cells as large as a typical piece, and not many more than pieces."""
    typical = float(np.median(np.linalg.norm(end - start, axis=1) + 2.0 * reach))
    fewest = float(np.cbrt(np.prod(high - low) / (_CELLS_PER_PIECE * len(start) + 64)))
    return max(typical, fewest, 1e-9)


@jit
def _list_pieces(
    start: Any, end: Any, reach: Any, low: Any, cell: float, shape: Any
) -> tuple[Any, Any]:
    """Pieces of each cell: cell c holds ``item[first[c]:first[c + 1]]``."""
    total = shape[0] * shape[1] * shape[2]
    first = np.zeros(total + 1, np.int64)
    item = np.zeros(0, np.int32)
    at = first
    for fill in range(2):
        if fill == 1:
            first[1:] = np.cumsum(first[1:])
            item = np.empty(first[-1], np.int32)
            at = first.copy()
        for i in range(len(start)):
            a, b, r = start[i], end[i], reach[i]
            lo = np.empty(3, np.int64)
            hi = np.empty(3, np.int64)
            for x in range(3):
                lo[x] = max(0, int((min(a[x], b[x]) - r - low[x]) / cell))
                hi[x] = min(shape[x] - 1, int((max(a[x], b[x]) + r - low[x]) / cell))
            far = r + 0.8660254037844387 * cell
            for p in range(lo[0], hi[0] + 1):
                for q in range(lo[1], hi[1] + 1):
                    for s in range(lo[2], hi[2] + 1):
                        d, _ = point_segment(
                            low[0] + (p + 0.5) * cell,
                            low[1] + (q + 0.5) * cell,
                            low[2] + (s + 0.5) * cell,
                            a[0], a[1], a[2], b[0], b[1], b[2],
                        )  # fmt: skip
                        if d > far:
                            continue
                        here = (p * shape[1] + q) * shape[2] + s
                        if fill == 0:
                            first[here + 1] += 1
                        else:
                            item[at[here]] = i
                            at[here] += 1
    return first, item


@jit
def _pairs_in_cells(
    first: Any,
    item: Any,
    start: Any,
    end: Any,
    radius: Any,
    nodes: Any,
    clearance: float,
    ratio: float,
    pairs: Any,
    values: Any,
) -> int:
    """Write close pairs (some more than once); return how many there are, written or not."""
    count = 0
    for c in range(len(first) - 1):
        for x in range(first[c], first[c + 1]):
            i = item[x]
            a, b = start[i], end[i]
            for y in range(x + 1, first[c + 1]):
                j = item[y]
                if (
                    nodes[i, 0] == nodes[j, 0]
                    or nodes[i, 0] == nodes[j, 1]
                    or nodes[i, 1] == nodes[j, 0]
                    or nodes[i, 1] == nodes[j, 1]
                ):
                    continue
                p, q = start[j], end[j]
                d, s, t = segment_segment(
                    a[0], a[1], a[2], b[0], b[1], b[2], p[0], p[1], p[2], q[0], q[1], q[2]
                )
                gap = d - radius[i] - radius[j]
                if gap >= max(clearance, ratio * min(radius[i], radius[j])):
                    continue
                if count < len(pairs):
                    pairs[count, 0], pairs[count, 1] = min(i, j), max(i, j)
                    values[count, 0] = gap
                    for k in range(3):
                        one = a[k] + s * (b[k] - a[k])
                        two = p[k] + t * (q[k] - p[k])
                        values[count, k + 1] = 0.5 * (one + two)
                count += 1
    return count
