"""Round the seams of united overlapping vessels by moving the surface's vertices.

A point x of the union's surface that a ball of radius ρ, rolling outside, can't reach goes to the
ball nearest to it: with x + v the nearest place of the ball's centre (see `fillet`), to
x + (1 - ρ/|v|) v. Triangles are parted where the surface bends, and moved; its genus stays.

Walls that come nearer than 2ρ without meeting would both go to the ball beyond their gap. So the
result is searched for crossings, the radius made smaller around each (to none at last), and the
work repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.crossings import find_crossings
from design.geometry.mesh import Edges, edges_of
from design.solids.smooth.fillet import least_step, wall_distance
from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray

FaceArray = NDArray[np.int64]


class _Limits(NamedTuple):
    """Limits of rounding; lengths in the fillet's radius."""

    growth: float = (
        1.0 / 3.0
    )  # of the radius per mm from a thin vessel or a place where it is small
    end: float = 0.5  # radius over the distance from a ring or a flat end, which stay
    wall_reach: float = 3.0  # of a wall that limits the radius: beyond, growth gives the whole one
    touching: int = 8  # walls that the ball may touch at once, the nearest
    walls: int = 256  # near a point
    ball_reach: float = 10.0  # of the ball's centre; farther is no room
    ball_steps: int = 40
    settled: float = 2e-3
    same_way: float = 1e-9  # of 1 - cosine: pieces of one straight vessel
    rounds: int = 9  # of halving edges
    edge: float = 0.12  # shorter edges aren't halved
    tries: int = 6
    shrink: float = 0.4  # of the radius around a place that fails
    sharp_after: int = 3  # tries; then such a place stays sharp


LIMITS: Final = _Limits()


@dataclass(frozen=True)
class Rounding:
    """Walls, fillet radii and ends of a surface that is to be rounded."""

    walls: FloatArray  # (w, 10), rows of `wall_rows`, of finite length
    rho: FloatArray  # (w,), mm, radius wanted at each wall's seams; at a seam the least counts
    ends: FloatArray  # (e, 7), mm, discs that keep their place: centre, axis, radius
    tolerance_mm: float  # greatest distance between triangles and the surface


def round_seams(
    vertices: FloatArray, faces: FaceArray, fixed: NDArray[np.bool_], what: Rounding
) -> tuple[FloatArray, FaceArray]:
    """Round the seams of a surface.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int64
        Their rim, if any, is of ``fixed`` vertices.
    fixed : (n,) bool
        Vertices that stay; an edge between two of them isn't parted.
    what : Rounding

    Returns
    -------
    vertices, faces
        The first n vertices are those given, in their order. As given where nothing can be
        rounded.
    """
    boxes = _boxes(what)
    limits = np.empty((0, 5))
    before = _crossing_vertices(vertices, faces, np.zeros(len(vertices), np.bool_))
    for attempt in range(LIMITS.tries):
        # From the sharp surface each time: triangles parted for a wider fillet are slivers for a
        # narrower one, and cross for that.
        work = RoundedSurface.of(vertices, faces, fixed)
        _round(work, what, boxes, limits)
        bad = work.failed.copy()
        went = np.any(work.moved != work.base, axis=1)
        bad[_crossing_vertices(work.moved, work.faces, went)] = True
        bad[: len(vertices)][before] = False
        if not bad.any():
            return work.moved, work.faces
        fresh = _smaller(work.base[bad], what, boxes, limits, attempt)
        limits = np.concatenate([limits, fresh])
    return vertices, faces


def _crossing_vertices(
    vertices: FloatArray, faces: FaceArray, moved: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the moved vertices (all, where none is) of faces that cross others."""
    crossing = np.unique(faces[find_crossings(vertices, faces).faces])
    return crossing[moved[crossing]] if moved.any() else crossing


def _smaller(
    places: FloatArray, what: Rounding, boxes: FloatArray, limits: FloatArray, attempt: int
) -> FloatArray:
    """Return new limits around ``places``, one for those within a radius of one another."""
    _, rho, _ = _moved(places, what, boxes, limits)
    smaller: list[FloatArray] = []
    for place, radius in zip(places, rho, strict=True):
        near = [row for row in smaller if np.linalg.norm(row[:3] - place) < row[3]]
        if not near:
            wide = max(2.0 * radius, 0.02 * float(what.rho.max()))
            small = 0.0 if attempt >= LIMITS.sharp_after else LIMITS.shrink * radius
            smaller.append(np.array([*place, wide * (1.0 + 0.5 * attempt), small]))
    return np.array(smaller)


def _boxes(what: Rounding) -> FloatArray:
    """Return the box (w, 6) around each wall within which it counts."""
    walls = what.walls
    end = walls[:, :3] + walls[:, 6:7] * walls[:, 3:6]
    wide = np.maximum(walls[:, 7], walls[:, 7] + walls[:, 8] * walls[:, 6])
    reach = (wide + LIMITS.wall_reach * float(what.rho.max()))[:, None]
    low, high = np.minimum(walls[:, :3], end) - reach, np.maximum(walls[:, :3], end) + reach
    return np.ascontiguousarray(np.concatenate([low, high], axis=1))


@dataclass
class RoundedSurface:
    """Surface under rounding."""

    base: FloatArray  # (n, 3), mm, points on the sharp surface
    moved: FloatArray  # (n, 3), mm, where they go
    failed: NDArray[np.bool_]  # (n,), no ball's place was found
    fixed: NDArray[np.bool_]  # (n,), points that stay
    faces: FaceArray

    @classmethod
    def of(cls, vertices: FloatArray, faces: FaceArray, fixed: NDArray[np.bool_]) -> RoundedSurface:
        """Begin with the sharp surface."""
        none = np.zeros(len(vertices), dtype=np.bool_)
        return cls(vertices, vertices.copy(), none, fixed, faces)

    def add(self, places: FloatArray, moved: FloatArray, failed: NDArray[np.bool_]) -> None:
        """Append points."""
        self.base = np.concatenate([self.base, places])
        self.moved = np.concatenate([self.moved, moved])
        self.failed = np.concatenate([self.failed, failed])
        self.fixed = np.concatenate([self.fixed, np.zeros(len(places), dtype=np.bool_)])


def _round(work: RoundedSurface, what: Rounding, boxes: FloatArray, limits: FloatArray) -> None:
    """Move the points, and part edges while the surface bends between them."""

    def move(points: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        return _moved(points, what, boxes, limits)

    free = ~work.fixed
    work.moved[free], _, work.failed[free] = move(work.base[free])
    seen = np.empty(0, dtype=np.int64)
    for _ in range(LIMITS.rounds):
        edges = edges_of(work.faces)
        one, two = edges.ends.T
        key = (one << 32) + two
        held = work.fixed[one] & work.fixed[two]
        ask = np.flatnonzero(~np.isin(key, seen) & ~held)
        parted = np.zeros(len(key), dtype=np.bool_)
        parted[ask] = _bends(work, one[ask], two[ask], move, what.tolerance_mm)
        seen = np.concatenate([seen, key[ask[~parted[ask]]]])
        if not parted.any():
            return
        middle = 0.5 * (work.base[one[parted]] + work.base[two[parted]])
        work.faces = part_faces(work.faces, edges, parted, len(work.base))
        moved, _, failed = move(middle)
        work.add(middle, moved, failed)


def _moved(
    points: FloatArray, what: Rounding, boxes: FloatArray, limits: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return where points go, the fillet's radius there, and whether no ball's place was found."""
    moved, rho = np.empty_like(points), np.empty(len(points))
    failed = np.zeros(len(points), dtype=np.bool_)
    fields = (what.walls, what.rho, what.ends, boxes, limits)
    _move(np.ascontiguousarray(points), fields, moved, rho, failed, 0.1 * what.tolerance_mm)
    return moved, rho, failed


def _bends(
    work: RoundedSurface,
    one: NDArray[np.int64],
    two: NDArray[np.int64],
    move: Callable[[FloatArray], tuple[FloatArray, FloatArray, NDArray[np.bool_]]],
    tolerance_mm: float,
) -> NDArray[np.bool_]:
    """Return which edges (e,) the surface leaves by more than the tolerance."""
    length = np.linalg.norm(work.base[one] - work.base[two], axis=1)
    sharp = np.zeros(len(one), dtype=np.bool_)
    for share in (0.5, 0.25, 0.75):
        at = (1.0 - share) * work.base[one] + share * work.base[two]
        goes, radius, _ = move(at)
        flat = (1.0 - share) * work.moved[one] + share * work.moved[two]
        way = goes - at
        size = np.linalg.norm(way, axis=1)
        along = np.abs(np.sum((goes - flat) * way, axis=1)) / np.where(size > 0.0, size, 1.0)
        # Where the middle stays, what its ends do bends the line all the same.
        error = np.where(size > 0.0, along, np.linalg.norm(flat - at, axis=1))
        sharp |= (error > tolerance_mm) & (length > LIMITS.edge * radius)
    return sharp


@jit
def _outside(box: FloatArray, x: float, y: float, z: float) -> bool:
    low = x < box[0] or y < box[1] or z < box[2]
    return bool(low or x > box[3] or y > box[4] or z > box[5])


@jit
def _radius_at(
    walls: FloatArray,
    wanted: FloatArray,
    ends: FloatArray,
    boxes: FloatArray,
    limits: FloatArray,
    x: float,
    y: float,
    z: float,
) -> float:
    """Return the fillet's radius at a point: the least that walls, ends and limits allow."""
    rho = inf
    for w in range(len(walls)):
        if _outside(boxes[w], x, y, z):
            continue
        a, _, _, _ = wall_distance(walls[w], x, y, z)
        rho = min(rho, wanted[w] + LIMITS.growth * max(0.0, a))
    for e in range(len(ends)):
        dx, dy, dz = x - ends[e, 0], y - ends[e, 1], z - ends[e, 2]
        along = dx * ends[e, 3] + dy * ends[e, 4] + dz * ends[e, 5]
        across = sqrt(max(0.0, dx * dx + dy * dy + dz * dz - along * along))
        over = max(0.0, across - ends[e, 6])
        rho = min(rho, LIMITS.end * sqrt(along * along + over * over))
    for k in range(len(limits)):
        dx, dy, dz = x - limits[k, 0], y - limits[k, 1], z - limits[k, 2]
        square, far = dx * dx + dy * dy + dz * dz, limits[k, 3] + rho / LIMITS.growth
        if square > far * far:
            continue
        over = max(0.0, sqrt(square) - limits[k, 3])
        rho = min(rho, limits[k, 4] + LIMITS.growth * over)
    return rho


@pjit
def _move(
    points: FloatArray,
    fields: Any,
    moved: FloatArray,
    radius: FloatArray,
    failed: NDArray[np.bool_],
    least: float,
) -> None:
    """Move points of the union; failed where no ball's place was found."""
    for m in prange(len(points)):
        _move_one(points, m, fields, moved, radius, failed, least)


@jit
def _walls_near(
    walls: FloatArray,
    boxes: FloatArray,
    rho: float,
    x: float,
    y: float,
    z: float,
    near: IntArray,
) -> tuple[int, int, float]:
    """List the walls that the ball's centre can reach in ``near``.

    Return how many there are (-1: too many), how many the ball may touch, and the distance from
    the nearest.
    """
    count, within, out = 0, 0, inf
    for w in range(len(walls)):
        if _outside(boxes[w], x, y, z):
            continue
        a, _, _, _ = wall_distance(walls[w], x, y, z)
        within += a < 2.0 * rho
        out = min(out, a)
        if a < LIMITS.ball_reach * rho:
            if count == LIMITS.walls:
                return -1, within, out
            near[count] = w
            count += 1
    return count, within, out


@jit
def _move_one(
    points: FloatArray,
    m: int,
    fields: Any,
    moved: FloatArray,
    radius: FloatArray,
    failed: NDArray[np.bool_],
    least: float,
) -> None:
    """Move one point; long, since its work arrays would otherwise be passed on at each step."""
    walls, wanted, ends, boxes, limits = fields
    x, y, z = points[m, 0], points[m, 1], points[m, 2]
    moved[m, 0], moved[m, 1], moved[m, 2] = x, y, z
    rho = _radius_at(walls, wanted, ends, boxes, limits, x, y, z)
    radius[m] = rho
    if rho <= 0.0 or rho == inf:
        return
    near = np.empty(LIMITS.walls, np.int64)
    count, within, out = _walls_near(walls, boxes, rho, x, y, z, near)
    if count < 0:
        failed[m] = True
        return
    if within < 2:
        return
    n = np.empty((LIMITS.touching, 3))
    b = np.empty(LIMITS.touching)
    cx, cy, cz = x, y, z
    size, settled = 0.0, False
    for _ in range(LIMITS.ball_steps):
        used, clear = 0, True
        for k in range(count):
            a, gx, gy, gz = wall_distance(walls[near[k]], cx, cy, cz)
            clear = clear and a >= (1.0 - LIMITS.settled) * rho
            if a > 3.0 * rho:
                continue
            need = rho - a - gx * (x - cx) - gy * (y - cy) - gz * (z - cz)
            place = used
            # Pieces of one straight vessel push the same way: the nearer one is enough.
            for other in range(used):
                if gx * n[other, 0] + gy * n[other, 1] + gz * n[other, 2] > 1.0 - LIMITS.same_way:
                    place = other
            if place < used:
                if b[place] >= need:
                    continue
            elif used == LIMITS.touching:
                place = int(np.argmin(b))
                if b[place] >= need:
                    continue
            else:
                used += 1
            n[place, 0], n[place, 1], n[place, 2], b[place] = gx, gy, gz, need
        if clear and settled:
            break
        vx, vy, vz = least_step(n, b, used)
        step = sqrt((x + vx - cx) ** 2 + (y + vy - cy) ** 2 + (z + vz - cz) ** 2)
        settled = step < LIMITS.settled * rho
        cx, cy, cz = x + vx, y + vy, z + vz
        size = sqrt(vx * vx + vy * vy + vz * vz)
    # Facets lie a little within the walls; what is filled is measured from them.
    depth = size - rho + out
    if depth <= least:
        return
    if not settled or size > LIMITS.ball_reach * rho:
        failed[m] = True
        return
    share = depth / size
    moved[m, 0] = x + share * (cx - x)
    moved[m, 1] = y + share * (cy - y)
    moved[m, 2] = z + share * (cz - z)


def part_faces(faces: IntArray, edges: Edges, parted: NDArray[np.bool_], first: int) -> IntArray:
    """Halve the ``parted`` (e,) edges of faces (m, 3), without leaving gaps.

    New vertices are numbered from ``first`` in the order of the parted edges.
    """
    number = np.full(len(edges.ends), -1)
    number[parted] = first + np.arange(int(parted.sum()))
    middle = number[edges.of_face.reshape(-1, 3)]
    halved = middle >= 0
    count = halved.sum(axis=1)
    parts = [faces[count == 0]]
    # Turned so that the edge that is alone, parted or not, leaves the first corner.
    for alone in (1, 2):
        rows = np.flatnonzero(count == alone)
        lone = np.argmax(halved[rows] == (alone == 1), axis=1)
        turn = (lone[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[rows], turn, axis=1).T
        ab, bc, ca = np.take_along_axis(middle[rows], turn, axis=1).T
        if alone == 1:
            parts += [np.stack([a, ab, c], 1), np.stack([ab, b, c], 1)]
        else:
            parts += [np.stack([a, b, bc], 1), np.stack([a, bc, ca], 1), np.stack([ca, bc, c], 1)]
    rows = np.flatnonzero(count == 3)
    a, b, c = faces[rows].T
    ab, bc, ca = middle[rows].T
    corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    parts += [np.stack(corner, 1) for corner in corners]
    return np.concatenate(parts)
