"""Triangles of a surface that pass through one another.

Every two triangles whose boxes meet are tried, neighbours too. The signs of tetrahedra decide,
each with a bound of its rounding (Shewchuk 1997, doi 10.1007/PL00009321, his first filter), so a
crossing that is reported is one, and what rounding can't tell is counted apart, as touching.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry import build_triangle_tree
from design.geometry.bvh import DEPTH
from kernels import jit, pjit

IntArray = NDArray[np.int64]

_ROUNDING = 8e-16
"""Of a 3 x 3 determinant over the sum of its terms' sizes: Shewchuk's (7 + 56 ε) ε, rounded up."""

APART, CROSSING, TOUCHING = 0, 1, 2


@dataclass(frozen=True)
class Crossings:
    """What passes through what.

    Attributes
    ----------
    crossing : (k, 2) int64
        Pairs of faces: an edge of one goes through the inside of the other, or two neighbours
        are folded flat onto one another. A face that crosses several is listed with one of them.
    touching : int
        Faces that meet another one, or lie in its plane over it, so exactly that rounding of the
        determinants hides on which side they are.
    """

    crossing: IntArray
    touching: int


def find_crossings(vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> Crossings:
    """Faces that pass through one another.

    Parameters
    ----------
    vertices : (n, 3) float64
        Taken as exact; faces that share a vertex share its number.
    faces : (m, 3)
        Without equal corners.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    tree = build_triangle_tree(np.ascontiguousarray(vertices, dtype=np.float64), corners)
    partner = np.full(len(corners), -1, np.int64)
    touches = np.zeros(len(corners), np.bool_)
    _search(tree, corners, partner, touches)
    found = np.flatnonzero(partner >= 0)
    pairs = np.stack([tree.face[found], tree.face[partner[found]]], axis=1).astype(np.int64)
    return Crossings(pairs[np.lexsort(pairs.T[::-1])], int(touches.sum()))


@pjit
def _search(tree: Any, faces: Any, partner: Any, touches: Any) -> None:
    """For each triangle of the tree a later one that it crosses, and whether it touches any."""
    for n in prange(len(tree.triangles)):
        _search_one(tree, faces, n, partner, touches)


@jit
def _search_one(tree: Any, faces: Any, n: int, partner: Any, touches: Any) -> None:
    one = tree.triangles[n].reshape(3, 3)
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        low[axis] = min(one[0, axis], min(one[1, axis], one[2, axis]))
        high[axis] = max(one[0, axis], max(one[1, axis], one[2, axis]))
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        apart = False
        for axis in range(3):
            if low[axis] > tree.high[node, axis] or high[axis] < tree.low[node, axis]:
                apart = True
        if apart:
            continue
        if tree.right[node] >= 0:
            stack[top] = tree.right[node]
            stack[top + 1] = node + 1
            top += 2
            continue
        for m in range(max(n + 1, tree.first[node]), tree.first[node] + tree.size[node]):
            two = tree.triangles[m].reshape(3, 3)
            for axis in range(3):
                if max(two[0, axis], max(two[1, axis], two[2, axis])) < low[axis]:
                    apart = True
                if min(two[0, axis], min(two[1, axis], two[2, axis])) > high[axis]:
                    apart = True
            if apart:
                apart = False
                continue
            met = _meet(one, two, faces[tree.face[n]], faces[tree.face[m]])
            if met == CROSSING:
                partner[n] = m
                return
            if met == TOUCHING:
                touches[n] = True


@jit
def side(a: Any, b: Any, c: Any, d: Any) -> int:
    """On which side of the plane abc d lies: 1 or -1, 0 where rounding hides it."""
    ax, ay, az = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    bx, by, bz = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    cx, cy, cz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    p, q = bx * cy, cx * by
    r, s = cx * ay, ax * cy
    t, u = ax * by, bx * ay
    det = az * (p - q) + bz * (r - s) + cz * (t - u)
    size = (abs(p) + abs(q)) * abs(az) + (abs(r) + abs(s)) * abs(bz) + (abs(t) + abs(u)) * abs(cz)
    if det > _ROUNDING * size:
        return 1
    return -1 if det < -_ROUNDING * size else 0


@jit
def _pierces(p: Any, q: Any, tri: Any, over: int, under: int) -> int:
    """Whether pq goes through the inside of ``tri``, its ends being on the sides given."""
    if over * under > 0 or (over == 0 and under == 0):
        return APART
    one = side(p, q, tri[0], tri[1])
    two = side(p, q, tri[1], tri[2])
    if one * two < 0:
        return APART
    three = side(p, q, tri[2], tri[0])
    if one * three < 0 or two * three < 0:
        return APART
    if over * under < 0 and one != 0 and two != 0 and three != 0:
        return CROSSING
    return TOUCHING


@jit
def _meet(one: Any, two: Any, corners: Any, others: Any) -> int:
    """How two triangles (3, 3) meet; corners with the same number are one point."""
    shared = 0
    own, its = np.full(3, -1), np.full(3, -1)
    for i in range(3):
        for j in range(3):
            if corners[i] == others[j]:
                own[i], its[j] = j, i
                shared += 1
    if shared == 3:
        return CROSSING
    sides = np.zeros(3, np.int64)
    plus, minus = 0, 0
    for j in range(3):
        if its[j] < 0:
            sides[j] = side(one[0], one[1], one[2], two[j])
            plus += sides[j] > 0
            minus += sides[j] < 0
    if shared == 2:
        return _folded(one, two, own, its) if plus + minus == 0 else APART
    if plus == 3 - shared or minus == 3 - shared:
        return APART
    if plus + minus == 0:
        return _overlap(one, two, own, its)
    met = APART
    for j in range(3):
        k = (j + 1) % 3
        if its[j] < 0 and its[k] < 0:
            found = _pierces(two[j], two[k], one, sides[j], sides[k])
            if found == CROSSING:
                return CROSSING
            met = max(met, found)
    for i in range(3):
        sides[i] = 0 if own[i] >= 0 else side(two[0], two[1], two[2], one[i])
    for i in range(3):
        k = (i + 1) % 3
        if own[i] < 0 and own[k] < 0:
            found = _pierces(one[i], one[k], two, sides[i], sides[k])
            if found == CROSSING:
                return CROSSING
            met = max(met, found)
    return met


@jit
def _flat(tri: Any) -> tuple[int, int]:
    """The two axes along which a triangle is best looked at."""
    u, v = tri[1] - tri[0], tri[2] - tri[0]
    normal = np.abs(np.cross(u, v))
    drop = int(np.argmax(normal))
    return (drop + 1) % 3, (drop + 2) % 3


@jit
def _turn(a: Any, b: Any, c: Any, x: int, y: int) -> int:
    left = (a[x] - c[x]) * (b[y] - c[y])
    right = (a[y] - c[y]) * (b[x] - c[x])
    det, size = left - right, abs(left) + abs(right)
    if det > _ROUNDING * size:
        return 1
    return -1 if det < -_ROUNDING * size else 0


@jit
def _folded(one: Any, two: Any, own: Any, its: Any) -> int:
    """Two neighbours in one plane: whether their third corners are on the same side."""
    i, j = 0, 0
    for k in range(3):
        if own[k] < 0:
            i = k
        if its[k] < 0:
            j = k
    x, y = _flat(one)
    s, t = one[(i + 1) % 3], one[(i + 2) % 3]
    return CROSSING if _turn(s, t, one[i], x, y) * _turn(s, t, two[j], x, y) > 0 else APART


@jit
def _overlap(one: Any, two: Any, own: Any, its: Any) -> int:
    """Two triangles in one plane: whether a line along an edge of either parts them."""
    x, y = _flat(one)
    for turn in range(2):
        tri, other = (one, two) if turn == 0 else (two, one)
        for i in range(3):
            a, b, c = tri[i], tri[(i + 1) % 3], tri[(i + 2) % 3]
            inner = _turn(a, b, c, x, y)
            parts = True
            for j in range(3):
                if _turn(a, b, other[j], x, y) * inner > 0:
                    parts = False
            if parts:
                return APART
    return TOUCHING
