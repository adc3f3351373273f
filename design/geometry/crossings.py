"""Find all pairs of triangles of a surface that intersect each other, exactly.

Every two triangles whose boxes meet are tried, neighbours too. The signs of tetrahedra decide,
each with a bound of its rounding (Shewchuk 1997, doi 10.1007/PL00009321, his first filter); the
few pairs that this leaves open are decided in whole numbers (`triangles_meet`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.bvh import (
    DEPTH,
    TriangleTree,
    boxes_apart,
    boxes_of,
    build_triangle_tree,
    corners_box,
)
from design.geometry.exact_triangles import triangles_meet
from kernels import jit, pjit
from kernels.arrays import IntArray

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
    leaf = np.flatnonzero(tree.right < 0)
    groups = _Groups(
        leaf,
        tree.low[leaf],
        tree.high[leaf],
        tree.first[leaf],
        tree.size[leaf],
        tree.triangles,
        tree.face,
    )
    return Crossings(_sorted(_crossing_pairs(vertices, corners, groups, corners, tree)))


def find_new_crossings(
    vertices: NDArray[np.float64], faces: NDArray[np.integer], fresh: NDArray[np.bool_]
) -> Crossings:
    """Find all pairs of faces, one of them ``fresh`` at least, that pass through one another.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3)
        As `find_crossings` takes them.
    fresh : (m,) bool
        Few: a tree is made of these alone. Pairs of others aren't tried.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    new, old = np.flatnonzero(fresh), np.flatnonzero(~fresh)
    if len(new) == 0:
        return Crossings(np.empty((0, 2), np.int64))
    tree = build_triangle_tree(vertices, corners[new])
    among = new[find_crossings(vertices, corners[new], tree).pairs]
    one, two = find_meetings(vertices, corners[old], tree, corners[new]).T
    return Crossings(_sorted(np.concatenate([among, np.stack([old[one], new[two]], axis=1)])))


def find_meetings(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    tree: TriangleTree,
    others: NDArray[np.int32],
) -> NDArray[np.int64]:
    """Pairs (k, 2) of one of ``faces`` (m, 3) and one of ``others`` (l, 3) that meet, unsorted.

    Parameters
    ----------
    tree : TriangleTree
        Of ``others``.
    """
    count = len(faces)
    number = np.arange(count, dtype=np.int32)
    corners = np.ascontiguousarray(vertices[faces])
    box = boxes_of(corners)
    groups = _Groups(
        np.full(count, -1),
        np.ascontiguousarray(box[:, :3]),
        np.ascontiguousarray(box[:, 3:]),
        number,
        np.ones(count, np.int32),
        corners.reshape(-1, 9),
        number,
    )
    return _crossing_pairs(vertices, faces, groups, others, tree)


class _Groups(NamedTuple):
    """Runs of triangles that are tried against a tree: its own leaves, or single other faces.

    Attributes
    ----------
    leaf : (g,) int64
        Node of the tree; -1 for others.
    low, high : (g, 3) float64
        Box of each run.
    first, size : (g,) int32
        Its triangles.
    triangles : (m, 9) float64
    face : (m,) int32
        Number of each triangle in the mesh.
    """

    leaf: IntArray
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    first: NDArray[np.int32]
    size: NDArray[np.int32]
    triangles: NDArray[np.float64]
    face: NDArray[np.int32]


def _crossing_pairs(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    groups: _Groups,
    others: NDArray[np.int32],
    tree: TriangleTree,
) -> IntArray:
    """Pairs (k, 2) of one of ``faces`` and one of ``others`` that cross.

    Those that rounding leaves open are decided in whole numbers.
    """
    count = np.zeros(len(groups.leaf), np.int64)
    pairs, status = np.empty((0, 2), np.int64), np.empty(0, np.int8)
    # Counted first, then written.
    for _ in range(2):
        begin = np.cumsum(count) - count
        pairs, status = np.empty((int(count.sum()), 2), np.int64), np.empty(count.sum(), np.int8)
        _find_pairs(groups, faces, tree, others, count, begin, pairs, status)
        if not count.any():
            break
    kept = status == CROSSING
    for index in np.flatnonzero(~kept).tolist():
        one, two = faces[pairs[index, 0]].tolist(), others[pairs[index, 1]].tolist()
        kept[index] = triangles_meet(vertices[one].tolist(), vertices[two].tolist(), one, two)
    return pairs[kept]


def _sorted(pairs: IntArray) -> IntArray:
    ordered = np.sort(pairs, axis=1)
    return np.asarray(ordered[np.lexsort(ordered.T[::-1])])


@pjit
def _find_pairs(
    groups: Any,
    faces: Any,
    tree: Any,
    others: Any,
    count: Any,
    begin: Any,
    pairs: Any,
    status: Any,
) -> None:
    """Count the pairs of each group that may cross; write them where there is space for pairs."""
    for g in prange(len(count)):
        if len(pairs) == 0:
            count[g] = _search(
                groups, int(np.int64(g)), faces, tree, others, _NOWHERE, pairs, status
            )
        elif count[g] > 0:
            _search(groups, int(np.int64(g)), faces, tree, others, begin[g], pairs, status)


@jit
def _search(
    groups: Any, g: int, faces: Any, tree: Any, others: Any, at: int, pairs: Any, status: Any
) -> int:
    """Pairs of a group and the tree, of its own later triangles; written from ``at`` if >= 0."""
    stack, least, most = np.empty(DEPTH, np.int32), np.empty(3), np.empty(3)
    stack[0] = 0
    top, count = 1, 0
    leaf, low, high = groups.leaf[g], groups.low[g], groups.high[g]
    first, last = groups.first[g], groups.first[g] + groups.size[g]
    mine, its = groups.triangles.reshape(-1, 3, 3), tree.triangles.reshape(-1, 3, 3)
    while top > 0:
        top -= 1
        node = stack[top]
        if _is_beyond(tree, node, low, high):
            continue
        right = tree.right[node]
        if right >= 0:
            stack[top] = right
            top += 1
            # Left of a node that isn't after the leaf's lie only triangles before its own.
            if right > leaf:
                stack[top] = node + 1
                top += 1
            continue
        if node < leaf:
            continue
        for n in range(first, last):
            one, corners = mine[n], faces[groups.face[n]]
            corners_box(one, least, most)
            begin = n + 1 if node == leaf else tree.first[node]
            for m in range(begin, tree.first[node] + tree.size[node]):
                two = its[m]
                if boxes_apart(two, least, most):
                    continue
                other = others[tree.face[m]]
                if _common_corners(corners, other) == 0 and _parted_across(one, two):
                    continue
                met = meeting_kind(one, two, corners, other)
                if met == APART:
                    continue
                if at >= 0:
                    pairs[at + count, 0], pairs[at + count, 1] = groups.face[n], tree.face[m]
                    status[at + count] = met
                count += 1
    return count


@jit
def _is_beyond(tree: Any, node: int, low: Any, high: Any) -> bool:
    """Whether a node's box and another don't meet."""
    for axis in range(3):
        if low[axis] > tree.high[node, axis] or high[axis] < tree.low[node, axis]:
            return True
    return False


@jit
def _common_corners(corners: Any, others: Any) -> int:
    """How many corners two triangles share, by their numbers (3,)."""
    shared = 0
    for i in range(3):
        shared += _place(corners[i], others) >= 0
    return shared


@jit
def _place(corner: int, others: Any) -> int:
    """Where a corner's number stands among ``others`` (3,); -1 where it doesn't."""
    if corner == others[0]:
        return 0
    if corner == others[1]:
        return 1
    return 2 if corner == others[2] else -1


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
    own = (_place(corners[0], others), _place(corners[1], others), _place(corners[2], others))
    its = (_place(others[0], corners), _place(others[1], corners), _place(others[2], corners))
    shared = (own[0] >= 0) + (own[1] >= 0) + (own[2] >= 0)
    if shared == 3:
        return CROSSING
    met = _meet_in_space(one, two, own, its, int(np.int64(shared)))
    return APART if met == OPEN and _parted_by_an_edge(one, two, own, its) else met


@jit
def _meet_in_space(one: Any, two: Any, own: Any, its: Any, shared: int) -> int:
    """Tell by signs of tetrahedra; ``own`` and ``its`` say which corners both have."""
    p, q, r = (
        0 if its[0] >= 0 else plane_side(one[0], one[1], one[2], two[0]),
        0 if its[1] >= 0 else plane_side(one[0], one[1], one[2], two[1]),
        0 if its[2] >= 0 else plane_side(one[0], one[1], one[2], two[2]),
    )
    plus = (p > 0) + (q > 0) + (r > 0)
    minus = (p < 0) + (q < 0) + (r < 0)
    if plus == 3 - shared or minus == 3 - shared:
        return APART
    if shared == 2:
        return OPEN
    met = _edges_pierce(two, one, its, (p, q, r))
    if met == CROSSING:
        return CROSSING
    p, q, r = (
        0 if own[0] >= 0 else plane_side(two[0], two[1], two[2], one[0]),
        0 if own[1] >= 0 else plane_side(two[0], two[1], two[2], one[1]),
        0 if own[2] >= 0 else plane_side(two[0], two[1], two[2], one[2]),
    )
    return max(met, _edges_pierce(one, two, own, (p, q, r)))


@jit
def _edges_pierce(tri: Any, other: Any, known: Any, sides: Any) -> int:
    """How the edges of ``tri`` without common corners meet ``other``, the worst of them."""
    met = APART
    for j in range(3):
        k = (j + 1) % 3
        if known[j] < 0 and known[k] < 0:
            met = max(met, _pierces(tri[j], tri[k], other, sides[j], sides[k]))
    return met


@jit
def _flat(tri: Any) -> tuple[int, int]:
    """The two axes along which a triangle is best looked at."""
    ux, uy, uz = tri[1, 0] - tri[0, 0], tri[1, 1] - tri[0, 1], tri[1, 2] - tri[0, 2]
    vx, vy, vz = tri[2, 0] - tri[0, 0], tri[2, 1] - tri[0, 1], tri[2, 2] - tri[0, 2]
    nx, ny, nz = abs(uy * vz - uz * vy), abs(uz * vx - ux * vz), abs(ux * vy - uy * vx)
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
