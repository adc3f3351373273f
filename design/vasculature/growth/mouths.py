"""Find places on a tissue's surface where a vessel may enter: inside a face, seen from above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.bvh import DEPTH, box_squared
from design.geometry.segments import point_triangle_squared
from design.tissue import Tissue
from design.tissue.grid_lines import cross_columns
from kernels import jit, pjit
from kernels.arrays import FloatArray


class MouthSettings(NamedTuple):
    """What makes a place on the surface fit for a vessel's mouth."""

    face_degrees: tuple[float, ...] = (15.0, 30.0, 45.0)
    """Turns of the surface up to which it still is one face; the flattest is preferred."""
    comfort: float = 1.5
    """Room around the mouth, and tissue ahead, over the least, beyond which more is no better."""
    lines: int = 2500
    """Lines of sight of each view."""
    depth_steps: int = 40
    """Samples of the depth ahead of each place."""
    least_facing: float = 0.5
    """Cosine between a face's normal and the view."""
    tries: int = 40
    """Places of each view and turn that are handed on, best first."""


MOUTHS = MouthSettings()

VIEWS = ((2, 1), (0, 1), (0, -1), (1, 1), (1, -1), (2, -1))
"""Axis and side that a place is seen from: from above, from the sides, from below."""


@dataclass(frozen=True)
class Mouth:
    """A place where a vessel may enter.

    Attributes
    ----------
    point, inward : (3,) float64
        mm, and the inward unit normal.
    room_mm : float
        Distance to the nearest edge or bend of the face; no more than `MouthSettings.comfort` times
        what was asked for.
    """

    point: FloatArray
    inward: FloatArray
    room_mm: float


def find_mouths(
    tissue: Tissue, reach_mm: float, direction: FloatArray | None = None
) -> Iterator[Mouth]:
    """Yield places that have one face all round, best first.

    A place is what a straight line of sight meets first, so that a needle or a fitting gets there:
    from above as long as there is one, then from the sides, then from below. Of each view come
    those first that have most room to edges and most tissue ahead; where there is plenty of both,
    the highest, and of equally high ones that in their middle.

    Parameters
    ----------
    tissue : Tissue
    reach_mm : float
        Radius of the vessel and its wall: no edge lies nearer.
    direction : (3,) float64, optional
        In which the vessel enters; the inward normal by default.
    """
    for views in (VIEWS[:1], VIEWS[1:5], VIEWS[5:]):
        for found in _fit_mouths(tissue, reach_mm, direction, views):
            first = _best_first(found, tissue)[: MOUTHS.tries]
            yield from (found.mouth(n) for n in first)


def far_mouths(
    tissue: Tissue, reach_mm: float, direction: FloatArray | None, taken: FloatArray
) -> Iterator[Mouth]:
    """Yield such places by their distance from points ``taken`` (k, 3), mm, the farthest first.

    Places with plenty of room come first, and those that are only seen from below last.
    """
    for views in (VIEWS[:5], VIEWS[5:]):
        for found in _fit_mouths(tissue, reach_mm, direction, views):
            away = np.linalg.norm(found.point[:, None] - taken[None], axis=2).min(axis=1)
            ample = found.ease >= MOUTHS.comfort
            first = np.lexsort([-np.round(away, 6), ~ample])[: MOUTHS.tries]
            yield from (found.mouth(n) for n in first)


class _Fit(NamedTuple):
    """Places that fit: (n, 3) points and outward normals, room, mm, and how easily they fit."""

    point: FloatArray
    normal: FloatArray
    room: FloatArray
    ease: FloatArray

    def mouth(self, n: int) -> Mouth:
        return Mouth(self.point[n], -self.normal[n], float(self.room[n]))


def _fit_mouths(
    tissue: Tissue,
    reach: float,
    direction: FloatArray | None,
    views: Sequence[tuple[int, int]],
) -> Iterator[_Fit]:
    """Places that fit among those seen in some views: in flat faces, then in more bent ones."""
    seen = [_seen(tissue, axis, side) for axis, side in views]
    point = np.concatenate([one for one, _ in seen])
    normal = np.concatenate([one for _, one in seen])
    if direction is not None:
        enters = normal @ direction <= -MOUTHS.least_facing
        point, normal = point[enters], normal[enters]
    if not len(point):
        return
    inward = -normal if direction is None else direction
    ahead = _depth_ahead(tissue, point, inward, MOUTHS.comfort * reach)
    for degrees in MOUTHS.face_degrees:
        room = face_room(tissue, point, normal, MOUTHS.comfort * reach, degrees)
        ease = np.minimum(room, ahead) / reach
        fit = ease >= 1.0
        if fit.any():
            yield _Fit(point[fit], normal[fit], room[fit], ease[fit])


def face_room(
    tissue: Tissue, point: FloatArray, normal: FloatArray, most_mm: float, degrees: float
) -> FloatArray:
    """Distance to the nearest surface that faces elsewhere, (n,), mm; at most ``most_mm``.

    Parameters
    ----------
    tissue : Tissue
    point, normal : (n, 3) float64
        On the surface, mm, and its unit normals there.
    most_mm : float
    degrees : float
        Angle to a place's normal from which a triangle faces elsewhere: beyond an edge or a bend.
    """
    least_cosine = float(np.cos(np.radians(degrees)))
    room: FloatArray = _face_room(tissue.grid.arrays, point, normal, most_mm, least_cosine)
    return room


@pjit
def _face_room(tree: Any, point: Any, normal: Any, most: float, least_cosine: float) -> Any:
    room = np.empty(len(point))
    for n in prange(len(point)):
        room[n] = _other_face(tree, point[n], normal[n], most, least_cosine)
    return room


@jit
def _other_face(tree: Any, at: Any, normal: Any, most: float, least_cosine: float) -> float:
    best = most * most
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if box_squared(tree, node, at[0], at[1], at[2]) >= best:
            continue
        other = tree.right[node]
        if other >= 0:
            stack[top] = other
            stack[top + 1] = node + 1
            top += 2
            continue
        for k in range(tree.first[node], tree.first[node] + tree.size[node]):
            if _cosine(tree.triangles[k], normal) < least_cosine:
                best = min(best, point_triangle_squared(at[0], at[1], at[2], tree.triangles[k]))
    return float(np.sqrt(best))


@jit
def _cosine(c: Any, normal: Any) -> float:
    """Cosine between a triangle's normal and another; 1 for a triangle without area."""
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = np.sqrt(x * x + y * y + z * z)
    if size == 0.0:
        return 1.0
    return (x * normal[0] + y * normal[1] + z * normal[2]) / size


def _seen(tissue: Tissue, axis: int, side: int) -> tuple[FloatArray, FloatArray]:
    """First places that lines along an axis meet, and outward normals there, (n, 3) each.

    Of the view from above the highest vertex is one, as long as it isn't on an edge.
    """
    corner = tissue.surface.vertices[tissue.surface.faces]
    first, second = (axis + 1) % 3, (axis + 2) % 3
    low, high = tissue.bounds
    width = (high - low)[[first, second]]
    step = float(np.sqrt(width.prod() / MOUTHS.lines))
    half = (0.5 * width / step).astype(np.int64)
    origin = 0.5 * (low + high)
    origin[[first, second]] -= half * step
    shape = (2 * int(half[0]) + 1, 2 * int(half[1]) + 1)
    columns = cross_columns(corner, axis, origin, step, shape)
    met = np.flatnonzero(np.diff(columns.start))
    at = columns.start[met + 1] - 1 if side > 0 else columns.start[met]
    point = np.empty((len(met), 3))
    point[:, axis] = columns.where[at]
    point[:, first] = origin[first] + step * (met // shape[1])
    point[:, second] = origin[second] + step * (met % shape[1])
    normal = _normals(corner[columns.face[at]])
    if (axis, side) == VIEWS[0]:
        top, inward = tissue.top_vertex()
        point, normal = np.vstack([top, point]), np.vstack([-inward, normal])
    facing = side * normal[:, axis] >= MOUTHS.least_facing
    return point[facing], normal[facing]


def _normals(corner: FloatArray) -> FloatArray:
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    unit: FloatArray = across / np.where(size > 0.0, size, 1.0)
    return unit


def _depth_ahead(
    tissue: Tissue, point: FloatArray, inward: FloatArray, most_mm: float
) -> FloatArray:
    """Largest depth on the way in before it leaves the tissue, (n,), mm; at most ``most_mm``."""
    along = np.linspace(0.0, 2.0 * most_mm, MOUTHS.depth_steps + 1)[1:, None]
    line = point[:, None] + along * np.broadcast_to(inward, point.shape)[:, None]
    depth = -tissue.grid.distance(line.reshape(-1, 3)).reshape(line.shape[:2])
    stays = np.logical_and.accumulate(depth > 0, axis=1)
    ahead: FloatArray = np.minimum(np.where(stays, depth, 0.0).max(axis=1), most_mm)
    return ahead


def _best_first(found: _Fit, tissue: Tissue) -> NDArray[np.int64]:
    """Order of places: the easiest, of these the highest, of these the nearest to their middle."""
    grain = 1e-6 * float(np.ptp(tissue.bounds))
    ease, height = np.round(found.ease, 1), np.round(found.point[:, 2] / grain)
    level = ease == ease.max()
    level &= height == height[level].max()
    away = np.linalg.norm(found.point - found.point[level].mean(axis=0), axis=1)
    return np.lexsort([np.round(away / grain), -height, -ease])
