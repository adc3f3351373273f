"""Remove self-intersections of a closed surface by small local changes.

Rounding to float32 moves vertices by up to half a step, and a boolean's result has slivers and
narrow wedges thinner than that: their sheets then pass through one another. Around each crossing
an edge is turned or drawn in, or a vertex moved by a few steps: whichever leaves the fewest
crossings, as long as the surface moves by no more than a given length. Vertices keep to float32.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry import build_triangle_tree
from design.geometry.bvh import TriangleTree
from design.geometry.crossings import find_crossings
from design.solids.mend_changes import draw_in, move, turn
from design.solids.mend_meeting import hits
from design.solids.remesh.halfedges import leaving, twins_of
from design.solids.topology import corner_fans
from kernels import jit
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int64]

_SHARES = (1 / 256, 1 / 64, 1 / 16, 1 / 4, 1 / 4, 1 / 4, 1.0, 1.0, 1.0)
"""Of the length by which a change may move the surface, round by round."""

_STEPS = 4
"""Lengths by which a vertex is moved: 2, 8, 32, 128 steps of float32."""

_APART = 4.0
"""Steps of float32 by which two fans of faces that touch in one vertex are drawn apart."""

_MOST = 1024
"""Faces around a vertex; one with more stays."""


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
    apart, together = _fans_apart(vertices, faces, fan, _APART * step)
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
    """Places of fans, those that touch in one vertex drawn into the solid; and whether any do."""
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
        patch=np.empty(_MOST, np.int64),
        within=np.zeros(len(faces), np.bool_),
    )


class MendedSurface(NamedTuple):
    """A surface while it is mended.

    Attributes
    ----------
    points : (v, 3) float64, mm
    faces, twin, out
        See `halfedges`.
    dead : (m,) bool
        Faces that were drawn in.
    changed : (m,) bool
        Faces that were moved.
    tree : TriangleTree
        Its boxes grow with what is changed; its triangles are those of before.
    above, leaf : (t,) and (m,) int64
        Parent of each box, -1 at the top; box of each face.
    patch : (k,) int64
        Faces that a change would concern.
    within : (m,) bool
        Whether each face is one of these.
    """

    points: FloatArray
    faces: FaceArray
    twin: NDArray[np.int64]
    out: NDArray[np.int64]
    dead: NDArray[np.bool_]
    changed: NDArray[np.bool_]
    tree: TriangleTree
    above: NDArray[np.int64]
    leaf: NDArray[np.int64]
    patch: NDArray[np.int64]
    within: NDArray[np.bool_]


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
            for way in range(2 * _STEPS):
                a = s.faces[f, k]
                gain = move(s, a, way, reach, step, False)
                if gain > best:
                    best, at, which = gain, a, way
        if best > 0:
            move(s, at, which, reach, step, True)


@jit
def _crossing(s: Any, faces: Any) -> Any:
    """Which of ``faces`` cross others."""
    kept = np.zeros(len(faces), np.bool_)
    for n in range(len(faces)):
        kept[n] = hits(s, faces[n], 0) > 0
    return faces[kept]
