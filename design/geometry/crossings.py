"""Find all pairs of triangles of a surface that intersect each other, exactly.

Every two triangles whose boxes meet are tried, neighbours too. The signs of tetrahedra decide,
each with a bound of its rounding (Shewchuk 1997, doi 10.1007/PL00009321, his first filter); the
few pairs that this leaves open are decided in whole numbers (`exact_meeting`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.boxes import boxes_apart, corners_box, next_leaf
from design.geometry.bvh import TriangleTree, build_triangle_tree
from design.geometry.exact_meeting import triangles_meet
from design.geometry.hierarchy import DEPTH
from kernels import jit, pjit

IntArray = NDArray[np.int64]

_ROUNDING = 8e-16
"""Of a 3 x 3 determinant over the sum of its terms' sizes: Shewchuk's (7 + 56 ε) ε, rounded up."""

_BLUR = 1e-14
"""Of the greatest sum of three products: differences and products to 2^-53 each, sums too."""

_NOWHERE: Any = np.int64(-1)
"""A kernel is compiled anew for each literal and for prange's own unsigned index."""

APART, OPEN, CROSSING = 0, 1, 2
"""How two triangles meet; OPEN where rounding hides it."""


@dataclass(frozen=True)
class Crossings:
    """Pairs of faces that intersect.

    Attributes
    ----------
    pairs : (k, 2) int64
        Every two faces that meet in more than the corners and edges which both have: that pass
        through one another, touch, or are folded flat onto one another. Sorted.
    """

    pairs: IntArray

    @property
    def faces(self) -> IntArray:
        """Faces of any pair, (f,), ascending."""
        return np.unique(self.pairs)


def find_crossings(
    vertices: NDArray[np.float64],
    faces: NDArray[np.integer],
    tree: TriangleTree | None = None,
) -> Crossings:
    """Find all pairs of faces that pass through one another, exactly.

    Parameters
    ----------
    vertices : (n, 3) float64
        Taken as exact; faces that share a vertex share its number.
    faces : (m, 3)
        Without equal corners.
    tree : TriangleTree, optional
        Of these vertices and faces, where it has been built.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    if tree is None:
        tree = build_triangle_tree(np.ascontiguousarray(vertices, dtype=np.float64), corners)
    count = np.zeros(len(corners), np.int64)
    _count(tree, corners, count)
    begin = np.cumsum(count) - count
    pairs = np.empty((int(count.sum()), 2), np.int64)
    status = np.empty(len(pairs), np.int8)
    _list(tree, corners, count, begin, pairs, status)
    kept = status == CROSSING
    for index in np.flatnonzero(~kept).tolist():
        one, two = corners[pairs[index]].tolist()
        kept[index] = triangles_meet(vertices[one].tolist(), vertices[two].tolist(), one, two)
    found = np.sort(pairs[kept], axis=1)
    return Crossings(found[np.lexsort(found.T[::-1])])


@pjit
def _count(tree: Any, faces: Any, count: Any) -> None:
    """For each triangle of the tree, how many later ones may cross it."""
    none, of = np.empty((0, 2), np.int64), np.empty(0, np.int8)
    for n in prange(len(count)):
        count[n] = _search(tree, faces, int(np.int64(n)), _NOWHERE, none, of)


@pjit
def _list(tree: Any, faces: Any, count: Any, begin: Any, pairs: Any, status: Any) -> None:
    """Write those pairs, by the mesh's own numbers, and how they meet."""
    for n in prange(len(count)):
        if count[n] > 0:
            _search(tree, faces, int(np.int64(n)), begin[n], pairs, status)


@jit
def _search(tree: Any, faces: Any, n: int, at: int, pairs: Any, status: Any) -> int:
    """Later triangles that may cross the n-th; written from ``at`` on where that isn't below 0."""
    one = tree.triangles[n].reshape(3, 3)
    low, high = np.empty(3), np.empty(3)
    corners_box(one, low, high)
    stack = np.zeros(DEPTH, np.int32)
    count = 0
    node, top = next_leaf(tree, low, high, stack, int(np.int64(1)))
    while node >= 0:
        for m in range(max(n + 1, tree.first[node]), tree.first[node] + tree.size[node]):
            two = tree.triangles[m].reshape(3, 3)
            if boxes_apart(two, low, high) or _parted_across(one, two):
                continue
            met = meeting_kind(one, two, faces[tree.face[n]], faces[tree.face[m]])
            if met == APART:
                continue
            if at >= 0:
                pairs[at + count, 0], pairs[at + count, 1] = tree.face[n], tree.face[m]
                status[at + count] = met
            count += 1
        node, top = next_leaf(tree, low, high, stack, top)
    return count


@jit
def _parted_across(one: Any, two: Any) -> bool:
    """Whether a plane along the longest edges parts two triangles, beyond what rounding blurs.

    Boxes of long, thin triangles (a rod's walls) meet by the million where the rods are far apart.
    """
    ux, uy, uz, long = _longest(one)
    vx, vy, vz, other = _longest(two)
    ox, oy, oz = one[0, 0], one[0, 1], one[0, 2]
    dx, dy, dz = two[0, 0] - ox, two[0, 1] - oy, two[0, 2] - oz
    if other > long:
        along = (dx * vx + dy * vy + dz * vz) / other
        px, py, pz = dx - along * vx, dy - along * vy, dz - along * vz
    else:
        along = (dx * ux + dy * uy + dz * uz) / long
        px, py, pz = dx - along * ux, dy - along * uy, dz - along * uz
    if _parted_along(one, two, px, py, pz):
        return True
    return _parted_along(one, two, uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)


@jit
def _longest(tri: Any) -> tuple[float, float, float, float]:
    """A triangle's longest edge, and the square of its length."""
    x, y, z, most = 0.0, 0.0, 0.0, -1.0
    for i in range(3):
        k = (i + 1) % 3
        dx, dy, dz = tri[k, 0] - tri[i, 0], tri[k, 1] - tri[i, 1], tri[k, 2] - tri[i, 2]
        square = dx * dx + dy * dy + dz * dz
        if square > most:
            x, y, z, most = dx, dy, dz, square
    return x, y, z, most


@jit
def _parted_along(one: Any, two: Any, x: float, y: float, z: float) -> bool:
    """Whether there is a gap between two triangles seen along a direction."""
    ox, oy, oz = one[0, 0], one[0, 1], one[0, 2]
    low, high, least, most, size = 0.0, 0.0, np.inf, -np.inf, 0.0
    for i in range(3):
        px, py, pz = x * (one[i, 0] - ox), y * (one[i, 1] - oy), z * (one[i, 2] - oz)
        at = px + py + pz
        low, high = min(low, at), max(high, at)
        qx, qy, qz = x * (two[i, 0] - ox), y * (two[i, 1] - oy), z * (two[i, 2] - oz)
        at = qx + qy + qz
        least, most = min(least, at), max(most, at)
        size = max(size, abs(px) + abs(py) + abs(pz), abs(qx) + abs(qy) + abs(qz))
    gap = max(least - high, low - most)
    return gap > _BLUR * size


@jit
def plane_side(a: Any, b: Any, c: Any, d: Any) -> int:
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
    """How pq and ``tri`` meet, p and q being on the sides given; 0 is open."""
    if over * under > 0:
        return APART
    one = plane_side(p, q, tri[0], tri[1])
    two = plane_side(p, q, tri[1], tri[2])
    if one * two < 0:
        return APART
    three = plane_side(p, q, tri[2], tri[0])
    if one * three < 0 or two * three < 0:
        return APART
    if over * under < 0 and one != 0 and two != 0 and three != 0:
        return CROSSING
    return OPEN


@jit
def meeting_kind(one: Any, two: Any, corners: Any, others: Any) -> int:
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
    met = _meet_in_space(one, two, own, its, int(np.int64(shared)))
    return APART if met == OPEN and _parted_by_an_edge(one, two, own, its) else met


@jit
def _meet_in_space(one: Any, two: Any, own: Any, its: Any, shared: int) -> int:
    """The same by signs of tetrahedra; ``own`` and ``its`` say which corners both have."""
    sides = np.zeros(3, np.int64)
    plus, minus = 0, 0
    for j in range(3):
        if its[j] < 0:
            sides[j] = plane_side(one[0], one[1], one[2], two[j])
            plus += sides[j] > 0
            minus += sides[j] < 0
    if plus == 3 - shared or minus == 3 - shared:
        return APART
    if shared == 2:
        return OPEN
    met = APART
    for j in range(3):
        k = (j + 1) % 3
        if its[j] < 0 and its[k] < 0:
            met = max(met, _pierces(two[j], two[k], one, sides[j], sides[k]))
    if met == CROSSING:
        return CROSSING
    for i in range(3):
        sides[i] = 0 if own[i] >= 0 else plane_side(two[0], two[1], two[2], one[i])
    for i in range(3):
        k = (i + 1) % 3
        if own[i] < 0 and own[k] < 0:
            met = max(met, _pierces(one[i], one[k], two, sides[i], sides[k]))
    return met


@jit
def _flat(tri: Any) -> tuple[int, int]:
    """The two axes along which a triangle is best looked at."""
    u, v = tri[1] - tri[0], tri[2] - tri[0]
    nx = abs(u[1] * v[2] - u[2] * v[1])
    ny = abs(u[2] * v[0] - u[0] * v[2])
    nz = abs(u[0] * v[1] - u[1] * v[0])
    if nx >= ny and nx >= nz:
        return 1, 2
    return (2, 0) if ny >= nz else (0, 1)


@jit
def _turn(a: Any, b: Any, c: Any, x: int, y: int) -> int:
    left = (a[x] - c[x]) * (b[y] - c[y])
    right = (a[y] - c[y]) * (b[x] - c[x])
    det, size = left - right, abs(left) + abs(right)
    if det > _ROUNDING * size:
        return 1
    return -1 if det < -_ROUNDING * size else 0


@jit
def _parted_by_an_edge(one: Any, two: Any, own: Any, its: Any) -> bool:
    """Whether a line along an edge of either parts them, seen along an axis.

    On that line there may only be corners that both have, and no two of either's but the edge.
    """
    x, y = _flat(one)
    for turn in range(2):
        tri, other, known = (one, two, its) if turn == 0 else (two, one, own)
        for i in range(3):
            k = (i + 1) % 3
            inner = _turn(tri[i], tri[k], tri[(i + 2) % 3], x, y)
            parted = inner != 0
            for j in range(3):
                on_edge = known[j] == i or known[j] == k
                if not on_edge and _turn(tri[i], tri[k], other[j], x, y) * inner >= 0:
                    parted = False
            if parted:
                return True
    return False
