"""STL files, exact distances, a tree of bounding boxes, and what lies in a closed surface.

Distances take all cases in turn instead of telling them apart: slower, and hard to get wrong.
The boxes are sorted along a Z-order curve (Morton 1966) and halved again and again. Node ``k`` of
level ``d`` (2^d <= k < 2^(d+1), the top is node 1) holds the sorted boxes from ``p n / 2^d`` to
``(p + 1) n / 2^d`` with p = k - 2^d, so that neither pointers nor ranges need be stored.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled

_FACET = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("spare", "<u2")])


def read_stl(path: Path) -> NDArray[np.float64]:
    """Return the corners (f, 3, 3), mm, of a binary STL, wound so that the volume is positive."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    if count == 0 or len(data) != 84 + count * _FACET.itemsize:
        raise ValueError(f"{path} isn't a binary STL with at least one facet")
    corners = np.frombuffer(data, _FACET, offset=84)["corner"].astype(np.float64)
    return corners if enclosed_volume(corners) > 0 else corners[:, ::-1].copy()


def enclosed_volume(triangles: NDArray[np.float64]) -> float:
    """Volume inside closed triangles (f, 3, 3), mm³ (divergence theorem)."""
    one, two, three = (triangles[:, k] - triangles[0, 0] for k in range(3))
    return float(np.einsum("ij,ij->i", one, np.cross(two, three)).sum() / 6.0)


def write_stl(path: Path, triangles: NDArray[np.float64]) -> None:
    """Write triangles (f, 3, 3), mm, as a binary STL; for the shapes that benchmarks make."""
    facets = np.zeros(len(triangles), _FACET)
    facets["corner"] = triangles
    path.write_bytes(bytes(80) + len(triangles).to_bytes(4, "little") + facets.tobytes())


def box_triangles(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """The twelve triangles of a box with corners ``low`` and ``high`` (3,)."""
    quads = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for side, level in ((0, low), (1, high)):
            corner = np.array(4 * [level], dtype=np.float64)
            corner[[1, 2], one], corner[[0, 3], one] = high[one], low[one]
            corner[[2, 3], two], corner[[0, 1], two] = high[two], low[two]
            quads.append(corner if side else corner[::-1])
    return np.array([quad[k] for quad in quads for k in ([0, 1, 2], [0, 2, 3])])


@compiled
def dot(a: Any, b: Any) -> Any:
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Any, b: Any) -> Any:
    """Vector product, a tuple of three."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def less(a: Any, b: Any) -> Any:
    """``a - b``, a tuple of three."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def point_segment(p: Any, a: Any, b: Any) -> Any:
    """Distance from point ``p`` to the segment from ``a`` to ``b``."""
    along, to = less(b, a), less(p, a)
    square = dot(along, along)
    t = min(1.0, max(0.0, dot(to, along) / square)) if square > 0.0 else 0.0
    x = to[0] - t * along[0]
    y = to[1] - t * along[1]
    z = to[2] - t * along[2]
    return np.sqrt(x * x + y * y + z * z)


@compiled
def segment_segment(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Distance between the segments ``a``-``b`` and ``c``-``d``.

    The least of the four ends' distances and, where the common normal of both lines stands within
    both segments, its length.
    """
    least = min(point_segment(a, c, d), point_segment(b, c, d))
    least = min(least, point_segment(c, a, b), point_segment(d, a, b))
    u, v, w = less(b, a), less(d, c), less(c, a)
    normal = cross(u, v)
    square = dot(normal, normal)
    if square > 1e-24 * dot(u, u) * dot(v, v):
        s = dot(cross(w, v), normal) / square
        t = dot(cross(w, u), normal) / square
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            least = min(least, abs(dot(w, normal)) / np.sqrt(square))
    return least


@compiled
def over_triangle(p: Any, one: Any, two: Any, three: Any) -> Any:
    """Whether the foot of the perpendicular from ``p`` to the triangle's plane lies within it."""
    normal = cross(less(two, one), less(three, one))
    side1 = dot(cross(less(two, one), less(p, one)), normal)
    side2 = dot(cross(less(three, two), less(p, two)), normal)
    side3 = dot(cross(less(one, three), less(p, three)), normal)
    return side1 >= 0.0 and side2 >= 0.0 and side3 >= 0.0


@compiled
def segment_triangle(a: Any, b: Any, one: Any, two: Any, three: Any) -> Any:
    """Distance between the segment ``a``-``b`` and a triangle; 0 where it pierces it."""
    least = min(segment_segment(a, b, one, two), segment_segment(a, b, two, three))
    least = min(least, segment_segment(a, b, three, one))
    normal = cross(less(two, one), less(three, one))
    size = np.sqrt(dot(normal, normal))
    if size == 0.0:
        return least
    above_a, above_b = dot(less(a, one), normal) / size, dot(less(b, one), normal) / size
    if over_triangle(a, one, two, three):
        least = min(least, abs(above_a))
    if over_triangle(b, one, two, three):
        least = min(least, abs(above_b))
    if above_a * above_b <= 0.0 and above_a != above_b:
        t = above_a / (above_a - above_b)
        at = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]))
        if over_triangle(at, one, two, three):
            least = 0.0
    return least


_PER_LEAF = 4


class BoxTree(NamedTuple):
    """Boxes sorted, and the boxes around them.

    ``order`` (n,): number that the i-th box along the curve has in the caller's arrays; ``around``
    (2^(levels + 1), 6): low and high corner of every node; ``levels``: level of the leaves.
    """

    order: NDArray[np.int64]
    around: NDArray[np.float64]
    levels: int


def box_tree(low: NDArray[np.float64], high: NDArray[np.float64]) -> BoxTree:
    """Build the tree over boxes with corners ``low`` and ``high`` (n, 3)."""
    middle = (low + high) / 2
    span = float((middle.max(axis=0) - middle.min(axis=0)).max()) or 1.0
    cells = ((middle - middle.min(axis=0)) * ((2**21 - 1) / span)).astype(np.uint64)
    order = np.argsort(_curve(cells), kind="stable")
    levels = max(0, int(np.ceil(np.log2(len(low) / _PER_LEAF))))
    return BoxTree(order, _around(low, high, order, levels), levels)


@compiled
def _curve(cells: Any) -> Any:
    """Place along the curve: the bits of the three coordinates in turn."""
    place = np.zeros(len(cells), np.uint64)
    for i in range(len(cells)):
        for axis in range(3):
            for bit in range(21):
                on = (cells[i, axis] >> np.uint64(bit)) & np.uint64(1)
                place[i] |= on << np.uint64(3 * bit + axis)
    return place


@compiled
def first_in(node: int, level: int, n: int) -> int:
    """First sorted box of a node; that of ``node + 1`` is one behind its last."""
    return ((node - (1 << level)) * n) >> level


@compiled
def _around(low: Any, high: Any, order: Any, levels: int) -> Any:
    n = len(order)
    around = np.empty((2 << levels, 6))
    around[:, :3] = np.inf
    around[:, 3:] = -np.inf
    for node in range(1 << levels, 2 << levels):
        for at in range(first_in(node, levels, n), first_in(node + 1, levels, n)):
            for axis in range(3):
                around[node, axis] = min(around[node, axis], low[order[at], axis])
                around[node, axis + 3] = max(around[node, axis + 3], high[order[at], axis])
    for node in range((1 << levels) - 1, 0, -1):
        for axis in range(3):
            around[node, axis] = min(around[2 * node, axis], around[2 * node + 1, axis])
            around[node, axis + 3] = max(around[2 * node, axis + 3], around[2 * node + 1, axis + 3])
    return around


@compiled
def meets(around: Any, node: int, low: Any, high: Any) -> bool:
    """Whether a box with corners ``low`` and ``high`` meets a node's box."""
    for axis in range(3):
        if around[node, axis] > high[axis] or around[node, axis + 3] < low[axis]:
            return False
    return True
