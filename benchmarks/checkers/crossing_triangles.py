"""Find self-intersecting triangles of a mesh file, without product code.

Triangles are sorted along a Z-order curve of their middles and boxed in runs of eight, pairs of
which are boxed again up to one box (the product: median splits). Two that meet in more than their
common corners and edges count. Volumes of tetrahedra larger than their rounding decide; what is
left is decided in Python's fractions, by clipping one triangle with the other. CGAL's
`Self_intersections` (by libigl) counts the same pairs.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RUN = 8
_ROUNDING = 2e-15
_APART, _UNSURE, _MEET = 0, 1, 2


def crossing_triangles(corners: FloatArray) -> IntArray:
    """Pairs (k, 2) of triangles (f, 3, 3) that cross, equal corners being one point."""
    number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    order = np.argsort(_along_curve(corners.mean(axis=1)), kind="stable")
    tri, name = np.ascontiguousarray(corners[order]), np.ascontiguousarray(number[order])
    low, high = tri.min(axis=1), tri.max(axis=1)
    levels = [_boxed(low, high, _RUN)]
    while len(levels[-1][0]) > 1:
        levels.append(_boxed(*levels[-1], 2))
    begin = np.cumsum([0, *(len(box[0]) for box in levels)])
    lows, highs = (np.concatenate([box[k] for box in levels]) for k in (0, 1))
    found = np.empty((1 << 16, 3), np.int64)
    while (count := _search(tri, name, low, high, lows, highs, begin, found)) > len(found):
        found = np.empty((count, 3), np.int64)
    kept = [
        (a, b)
        for a, b, met in found[:count].tolist()
        if met == _MEET or _meet_exactly(tri[a], tri[b], name[a].tolist(), name[b].tolist())
    ]
    return np.sort(order[np.array(kept, np.int64).reshape(-1, 2)], axis=1)


def _meet_exactly(one: Any, two: Any, mine: list[int], its: list[int]) -> bool:
    """Whether the common part of two triangles has a corner beyond what they share."""
    first, second = ([[Fraction(x) for x in place] for place in tri.tolist()] for tri in (one, two))
    if not any(_normal(first)) or not any(_normal(second)):
        return True
    both = [place for place, name in zip(first, mine, strict=True) if name in its]
    common = [place for place in _common(first, second) if place not in both]
    if len(both) == 2:
        along = _minus(both[1], both[0])
        common = [place for place in common if any(_across(along, _minus(place, both[0])))]
    return bool(common)


def _common(first: list[Any], second: list[Any]) -> list[Any]:
    """Corners of a triangle clipped to the plane of another, and to its three sides."""
    normal = _normal(second)
    planes = [(normal, second[0]), ([-x for x in normal], second[0])]
    for k in range(3):
        planes.append((_across(normal, _minus(second[(k + 1) % 3], second[k])), second[k]))
    kept = first
    for inward, through in planes:
        height = [sum(x * y for x, y in zip(inward, _minus(p, through), strict=True)) for p in kept]
        cut = []
        for k, (p, h) in enumerate(zip(kept, height, strict=True)):
            q, to = kept[(k + 1) % len(kept)], height[(k + 1) % len(kept)]
            if h >= 0:
                cut.append(p)
            if h * to < 0:
                cut.append([x + h / (h - to) * (y - x) for x, y in zip(p, q, strict=True)])
        kept = cut
    return kept


def _minus(a: Any, b: Any) -> list[Any]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _across(a: Any, b: Any) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _normal(tri: list[Any]) -> list[Any]:
    return _across(_minus(tri[1], tri[0]), _minus(tri[2], tri[0]))


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
def _search(
    corners: FloatArray,
    name: IntArray,
    least: FloatArray,
    most: FloatArray,
    low: FloatArray,
    high: FloatArray,
    begin: IntArray,
    out: IntArray,
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
                if apart:
                    continue
                met = _meet(corners[n], corners[m], name[n], name[m])
                if met != _APART:
                    if found < len(out):
                        out[found, 0], out[found, 1], out[found, 2] = n, m, met
                    found += 1
    return found


@compiled
def _volume(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> int:
    """Sign of a tetrahedron's volume; 0 within rounding."""
    u, v, w = b - a, c - a, d - a
    total = size = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        total += u[i] * (v[j] * w[k] - v[k] * w[j])
        size += abs(u[i]) * (abs(v[j] * w[k]) + abs(v[k] * w[j]))
    if abs(total) <= _ROUNDING * size:
        return 0
    return 1 if total > 0.0 else -1


@compiled
def _meet(one: FloatArray, two: FloatArray, mine: IntArray, its: IntArray) -> int:
    shared = 0
    for i in range(3):
        for j in range(3):
            shared += mine[i] == its[j]
    if shared == 3:
        return _MEET
    status = _APART
    for turn in range(2):
        tri, other = (one, two) if turn == 0 else (two, one)
        names, known = (its, mine) if turn == 0 else (mine, its)
        sides = np.zeros(3, np.int64)
        above = below = 0
        for k in range(3):
            if names[k] != known[0] and names[k] != known[1] and names[k] != known[2]:
                sides[k] = _volume(tri[0], tri[1], tri[2], other[k])
                above += sides[k] > 0
                below += sides[k] < 0
        if above == 3 - shared or below == 3 - shared:
            return _APART
        if above + below < 3 - shared:
            status = _UNSURE
    if status == _UNSURE or shared == 2:
        return _APART if _flat_apart(one, two, mine, its) else _UNSURE
    for turn in range(2):
        tri, edges = (one, two) if turn == 0 else (two, one)
        names, known = (its, mine) if turn == 0 else (mine, its)
        for k in range(3):
            begin, end = names[k], names[(k + 1) % 3]
            if begin in known or end in known:
                continue
            met = _through(edges[k], edges[(k + 1) % 3], tri)
            if met == _MEET:
                return _MEET
            status = max(status, met)
    return status


@compiled
def _through(p: FloatArray, q: FloatArray, tri: FloatArray) -> int:
    if _volume(tri[0], tri[1], tri[2], p) == _volume(tri[0], tri[1], tri[2], q):
        return _APART
    plus = minus = 0
    for k in range(3):
        side = _volume(p, q, tri[k], tri[(k + 1) % 3])
        plus += side > 0
        minus += side < 0
    if plus > 0 and minus > 0:
        return _APART
    return _MEET if plus == 3 or minus == 3 else _UNSURE


@compiled
def _flat_apart(one: FloatArray, two: FloatArray, mine: IntArray, its: IntArray) -> bool:
    """Whether the line of an edge parts the triangles, seen along x, y or z."""
    for drop in range(3):
        x, y = (drop + 1) % 3, (drop + 2) % 3
        for turn in range(2):
            tri, other = (one, two) if turn == 0 else (two, one)
            names, known = (mine, its) if turn == 0 else (its, mine)
            for k in range(3):
                a, b, c = tri[k], tri[(k + 1) % 3], tri[(k + 2) % 3]
                inner = _area(a[x], a[y], b[x], b[y], c[x], c[y])
                beyond = inner != 0
                for j in range(3):
                    if known[j] == names[k] or known[j] == names[(k + 1) % 3]:
                        continue
                    p = other[j]
                    if _area(a[x], a[y], b[x], b[y], p[x], p[y]) * inner >= 0:
                        beyond = False
                if beyond:
                    return True
    return False


@compiled
def _area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    left, right = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
    if abs(left - right) <= _ROUNDING * (abs(left) + abs(right)):
        return 0
    return 1 if left > right else -1
