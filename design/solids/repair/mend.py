"""Remove self-intersections of a closed surface by small local changes.

Rounding to float32 moves vertices by up to half a step, and a boolean's result has slivers and
narrow wedges thinner than that: their sheets then pass through one another. Around each crossing
an edge is turned or drawn in, or a vertex moved by a few steps: whichever leaves the fewest
crossings, as long as the surface moves by no more than a given length. Vertices keep to float32.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry import build_triangle_tree
from design.geometry.bvh import DEPTH, TriangleTree, boxes_apart, corners_box, next_leaf
from design.geometry.crossings import APART, find_crossings, meeting_kind
from design.solids.repair.half_edges import (
    apex,
    are_joined,
    collapse,
    flip,
    leaving,
    origin,
    previous_half_edge,
    tip,
    twins_of,
    valence,
)
from design.solids.repair.remesh import normal, stays_closed
from design.solids.topology import corner_fans
from kernels import jit
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int64]
_SHARES: Final = (1 / 256, 1 / 64, 1 / 16, 1 / 4, 1 / 4, 1 / 4, 1.0, 1.0, 1.0)
"""Of the length by which a change may move the surface, round by round."""
_FLOAT32_MOVES: Final = (2.0, 8.0, 32.0, 128.0)
"""Steps of float32 by which a vertex is moved."""
_FAN_GAP: Final = 4.0
"""Steps of float32 by which two fans of faces that touch in one vertex are drawn apart."""
_MAX_FACES: Final = 1024
"""Around a vertex; one with more stays."""


def mend_surface(
    vertices: FloatArray, faces: FaceArray, reach_mm: float
) -> tuple[FloatArray, FaceArray, NDArray[np.int64]]:
    """Mend a surface.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
        Each place once, as float32 holds it.
    faces : (m, 3) int64
        Closed and oriented.
    reach_mm : float, mm
        By how much one change may move the surface.

    Returns
    -------
    vertices, faces
        Closed and oriented as before; vertices may be unused.
    left : (k,) int64
        Faces that cross others still.
    """
    fan = corner_fans(faces)
    step = float(np.spacing(np.float32(np.abs(vertices).max())))
    apart, together = _fans_apart(vertices, faces, fan, _FAN_GAP * step)
    if together:
        vertices, faces = apart, fan
    tree = build_triangle_tree(np.ascontiguousarray(vertices), faces.astype(np.int32))
    left = find_crossings(vertices, faces, tree).faces
    if len(left) == 0:
        return vertices, faces, left
    surface = _surface(vertices, faces, tree)
    for share in _SHARES:
        _mend(surface, left, share * reach_mm, step)
        # What crosses now has been changed, or has crossed before.
        surface.changed[left] = True
        left = _crossing(surface, np.flatnonzero(surface.changed & ~surface.dead))
        if len(left) == 0:
            break
    points, faces = surface.points, surface.faces[~surface.dead]
    return points, faces, find_crossings(points, faces).faces if len(left) else left


def _fans_apart(
    vertices: FloatArray, faces: FaceArray, fan: FaceArray, step_mm: float
) -> tuple[FloatArray, bool]:
    """Draw fans that touch in one vertex into the solid; return places, and if there are any."""
    place = np.zeros(int(fan.max()) + 1, np.int64)
    place[fan] = faces
    points = vertices[place]
    touching = np.flatnonzero(np.bincount(place, minlength=len(vertices))[place] > 1)
    for one in touching.tolist():
        a, b, c = (points[fan[(fan == one).any(axis=1), k]] for k in range(3))
        normal = np.cross(b - a, c - a).sum(axis=0)
        points[one] -= step_mm * normal / max(float(np.linalg.norm(normal)), 1e-300)
    points[touching] = points[touching].astype(np.float32)
    return points, len(touching) > 0


def _surface(vertices: FloatArray, faces: FaceArray, tree: TriangleTree) -> MendedSurface:
    return MendedSurface(
        points=np.array(vertices),
        faces=np.array(faces),
        twin=twins_of(faces),
        out=leaving(faces, len(vertices)),
        dead=np.zeros(len(faces), np.bool_),
        changed=np.zeros(len(faces), np.bool_),
        tree=tree,
        above=_parents(tree.right),
        leaf=_leaves(tree.first, tree.size, tree.right, tree.face),
        patch=np.empty(_MAX_FACES, np.int64),
        within=np.zeros(len(faces), np.bool_),
    )


class MendedSurface(NamedTuple):
    """Surface under repair."""

    points: FloatArray  # (v, 3), mm
    faces: FaceArray  # with `twin` and `out` as in `design.solids.repair.remesh`
    twin: NDArray[np.int64]
    out: NDArray[np.int64]
    dead: NDArray[np.bool_]  # (m,), faces that were drawn in
    changed: NDArray[np.bool_]  # (m,), faces that were moved
    tree: TriangleTree  # its boxes grow with changes; its triangles are those of before
    above: NDArray[np.int64]  # (t,), parent of each box, -1 at the top
    leaf: NDArray[np.int64]  # (m,), box of each face
    patch: NDArray[np.int64]  # (k,), faces that a change concerns
    within: NDArray[np.bool_]  # (m,), whether each face is one of these


def _parents(right: NDArray[np.int32]) -> NDArray[np.int64]:
    above = np.full(len(right), -1, np.int64)
    inner = np.flatnonzero(right >= 0)
    above[inner + 1] = inner
    above[right[inner]] = inner
    return above


def _leaves(
    first: NDArray[np.int32],
    size: NDArray[np.int32],
    right: NDArray[np.int32],
    face: NDArray[np.int32],
) -> NDArray[np.int64]:
    nodes = np.flatnonzero(right < 0)
    nodes = nodes[np.argsort(first[nodes])]
    leaf = np.empty(len(face), np.int64)
    leaf[face] = np.repeat(nodes, size[nodes])
    return leaf


@jit
def _mend(s: Any, hot: Any, reach: float, step: float) -> None:
    """Make the best change at each of the faces ``hot`` that still crosses another."""
    for f in hot:
        if s.dead[f] or hits(s, f, 0) == 0:
            continue
        best, at, draws = 0, -1, False
        for k in range(3):
            h = 3 * f + k
            gain = turn(s, h, reach, False)
            if gain > best:
                best, at, draws = gain, h, False
            for half in (h, s.twin[h]):
                gain = draw_in(s, half, reach, False)
                if gain > best:
                    best, at, draws = gain, half, True
        if best > 0:
            if draws:
                draw_in(s, at, reach, True)
            else:
                turn(s, at, reach, True)
            continue
        which = 0
        for k in range(3):
            for way in range(2 * len(_FLOAT32_MOVES)):
                a = s.faces[f, k]
                gain = move(s, a, way, reach, step, False)
                if gain > best:
                    best, at, which = gain, a, way
        if best > 0:
            move(s, at, which, reach, step, True)


@jit
def _crossing(s: Any, faces: Any) -> Any:
    """Return those of ``faces`` that cross others."""
    kept = np.zeros(len(faces), np.bool_)
    for n in range(len(faces)):
        kept[n] = hits(s, faces[n], 0) > 0
    return faces[kept]


@jit
def turn(s: Any, h: int, reach: float, do: bool) -> int:
    """Return by how much turning an edge reduces crossings; 0 where it mustn't be turned."""
    faces, t = s.faces, s.twin[h]
    here, there = h // 3, t // 3
    a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, t)
    if c == d or valence(s.twin, s.out, a) <= 3 or valence(s.twin, s.out, b) <= 3:
        return 0
    if are_joined(faces, s.twin, s.out, c, d) or _thickness(s.points, a, b, c, d) > reach:
        return 0
    s.patch[0], s.patch[1] = here, there
    now = patch_hits(s, 2)
    mine, its = faces[here].copy(), faces[there].copy()
    if do:
        flip(faces, s.twin, s.out, h)
        grow(s, 2)
        return 0
    faces[here, 0], faces[here, 1], faces[here, 2] = a, d, c
    faces[there, 0], faces[there, 1], faces[there, 2] = b, c, d
    then = patch_hits(s, 2)
    faces[here], faces[there] = mine, its
    return now - then


@jit
def draw_in(s: Any, h: int, reach: float, do: bool) -> int:
    """Return the same for drawing a half-edge's origin into its tip."""
    faces, dead = s.faces, s.dead
    one, two = h // 3, s.twin[h] // 3
    a, b = origin(faces, h), tip(faces, h)
    count = _around(s, a)
    if count == 0 or not stays_closed(faces, s.twin, s.out, h):
        return 0
    g = h
    for _ in range(count):
        p, q = tip(faces, g), apex(faces, g)
        if p != b and q != b and not _may_turn(s.points, a, b, p, q, reach):
            return 0
        g = s.twin[previous_half_edge(g)]
    if do:
        collapse(faces, s.twin, s.out, h)
        dead[one] = dead[two] = True
        grow(s, count)
        return 0
    now = patch_hits(s, count)
    _rename(s, count, a, b)
    dead[one] = dead[two] = True
    then = patch_hits(s, count)
    dead[one] = dead[two] = False
    g = h
    for _ in range(count):
        faces[g // 3, g % 3] = a
        g = s.twin[previous_half_edge(g)]
    return now - then


@jit
def _rename(s: Any, count: int, a: int, b: int) -> None:
    for n in range(count):
        for k in range(3):
            if s.faces[s.patch[n], k] == a:
                s.faces[s.patch[n], k] = b


@jit
def move(s: Any, a: int, way: int, reach: float, step: float, do: bool) -> int:
    """Return the same for moving a vertex along its normal: out for even ``way``, in for odd."""
    points, count = s.points, _around(s, a)
    length = _FLOAT32_MOVES[way // 2] * step
    if count == 0 or length > reach:
        return 0
    nx = ny = nz = 0.0
    for n in range(count):
        f = s.patch[n]
        x, y, z = normal(points, s.faces[f, 0], s.faces[f, 1], s.faces[f, 2])
        nx, ny, nz = nx + x, ny + y, nz + z
    size = sqrt(nx * nx + ny * ny + nz * nz)
    if size == 0.0:
        return 0
    share = (length if way % 2 == 0 else -length) / size
    now = patch_hits(s, count)
    x, y, z = points[a, 0], points[a, 1], points[a, 2]
    points[a, 0] = np.float32(x + share * nx)
    points[a, 1] = np.float32(y + share * ny)
    points[a, 2] = np.float32(z + share * nz)
    if do:
        grow(s, count)
        return 0
    then = patch_hits(s, count)
    points[a, 0], points[a, 1], points[a, 2] = x, y, z
    return now - then


@jit
def _around(s: Any, a: int) -> int:
    """List the faces around a vertex in the patch; return how many, 0 if too many."""
    count, g = 0, s.out[a]
    while True:
        if count == len(s.patch):
            return 0
        s.patch[count] = g // 3
        count += 1
        g = s.twin[previous_half_edge(g)]
        if g == s.out[a]:
            return count


@jit
def _thickness(points: Any, a: int, b: int, c: int, d: int) -> float:
    """Return a tetrahedron's least height: six times its volume over twice its largest face."""
    x, y, z = normal(points, a, b, c)
    volume = abs(
        x * (points[d, 0] - points[a, 0])
        + y * (points[d, 1] - points[a, 1])
        + z * (points[d, 2] - points[a, 2])
    )
    largest = x * x + y * y + z * z
    for p, q, r in ((a, b, d), (b, c, d), (c, a, d)):
        x, y, z = normal(points, p, q, r)
        largest = max(largest, x * x + y * y + z * z)
    return volume / sqrt(largest) if largest > 0.0 else 0.0


@jit
def _may_turn(points: Any, a: int, b: int, p: int, q: int, reach: float) -> bool:
    """Return whether face apq may become bpq: near it, and not turned over unless a sliver."""
    if _thickness(points, a, b, p, q) > reach:
        return False
    x, y, z = normal(points, a, p, q)
    u, v, w = normal(points, b, p, q)
    if x * u + y * v + z * w > 0.0:
        return True
    longest = 0.0
    for i, j in ((a, p), (p, q), (q, a), (b, p), (q, b)):
        for k in range(3):
            longest = max(longest, abs(points[i, k] - points[j, k]))
    area = min(x * x + y * y + z * z, u * u + v * v + w * w)
    return sqrt(area) <= reach * longest


@jit
def grow(s: Any, count: int) -> None:
    """Enlarge the tree's boxes so that they hold the faces of the patch."""
    for n in range(count):
        f = s.patch[n]
        if s.dead[f]:
            continue
        s.changed[f] = True
        node = s.leaf[f]
        while node >= 0:
            for k in range(3):
                for axis in range(3):
                    value = s.points[s.faces[f, k], axis]
                    s.tree.low[node, axis] = min(s.tree.low[node, axis], value)
                    s.tree.high[node, axis] = max(s.tree.high[node, axis], value)
            node = s.above[node]


@jit
def patch_hits(s: Any, count: int) -> int:
    """Count the faces that those of the patch meet, one another included."""
    for n in range(count):
        s.within[s.patch[n]] = True
    total = 0
    for n in range(count):
        if not s.dead[s.patch[n]]:
            total += hits(s, s.patch[n], count)
    for n in range(count):
        s.within[s.patch[n]] = False
    return total


@jit
def hits(s: Any, face: int, count: int) -> int:
    """Count the faces that one meets, those included that rounding hides.

    The first ``count`` of the patch may be out of their boxes; each is tried.
    """
    tree = s.tree
    one, two = np.empty((3, 3)), np.empty((3, 3))
    mine, its = np.empty(3, np.int64), np.empty(3, np.int64)
    low, high = np.empty(3), np.empty(3)
    for k in range(3):
        mine[k] = s.faces[face, k]
        one[k] = s.points[s.faces[face, k]]
    corners_box(one, low, high)
    met = 0
    for n in range(count):
        if s.patch[n] != face:
            met += _met(s, s.patch[n], one, mine, low, high, two, its)
    stack = np.zeros(DEPTH, np.int32)
    node, top = next_leaf(tree, low, high, stack, 1)
    while node >= 0:
        for m in range(tree.first[node], tree.first[node] + tree.size[node]):
            other = tree.face[m]
            if other != face and not s.within[other]:
                met += _met(s, other, one, mine, low, high, two, its)
        node, top = next_leaf(tree, low, high, stack, top)
    return met


@jit
def _met(s: Any, other: int, one: Any, mine: Any, low: Any, high: Any, two: Any, its: Any) -> int:
    """Return 1 if a face meets ``other``, else 0."""
    if s.dead[other]:
        return 0
    for k in range(3):
        two[k] = s.points[s.faces[other, k]]
    if boxes_apart(two, low, high):
        return 0
    for k in range(3):
        its[k] = s.faces[other, k]
    return 0 if meeting_kind(one, two, mine, its) == APART else 1
