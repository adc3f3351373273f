"""Delaunay triangulation of points on the unit sphere (Lawson 1977): insert, then flip edges.

An edge is flipped while a neighbour's far corner stands over the plane of a triangle, which on
the sphere is the same as lying in its circumcircle.
"""

from __future__ import annotations

from math import sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from design.solids.smooth.fillet import leaves
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class _Limits(NamedTuple):
    """Limits of a junction's triangulation."""

    rounds: int = 12  # of refinement; each takes the error down about threefold
    cover: int = 24  # directions of the even cover
    blur: float = 1e-7  # of directions in line; far below a float32 step of a vertex
    flat: float = 1e-12  # height over a triangle's plane that is 0: a ring lies on one circle
    on_edge: float = 1e-15  # determinant of directions that is rounding
    same: float = 3e-4  # points nearer to a corner around them are left out
    flips: int = 2000  # after one point; a handful is usual, rounding could go on for ever


LIMITS: Final = _Limits()


@jit
def owner(walls: FloatArray, dx: float, dy: float, dz: float) -> int:
    """Return the vessel that a ray from the junction's middle leaves last."""
    far, vessel = -1.0, 0
    for i in range(len(walls)):
        t = leaves(walls[i], dx, dy, dz)
        if t > far:
            far, vessel = t, i
    return vessel


SEAM = -1
"""Owner of a point that lies on a seam, or on a fillet."""
CAP = -2
"""Owner of a vessel's axis, whose triangles are left out: there the tube goes on."""


class Junction(NamedTuple):
    """A junction, as `star_mesh` takes it."""

    walls: FloatArray
    rho: float
    reach: FloatArray
    rings: FloatArray
    ring_of: IntArray
    tolerance: float
    least: float


class Net(NamedTuple):
    """Directions from the middle, and triangles between them."""

    d: FloatArray  # (most, 3), unit directions
    away: FloatArray  # (most,), mm, distance of the surface
    owner: IntArray  # (most,), vessel, `SEAM` or `CAP`
    tri: IntArray  # (2 most, 3), corners of each triangle
    beside: IntArray  # (2 most, 3), its neighbours
    stack: IntArray  # (4 most,), work space of `insert`
    # (2 most, 4): corners of each triangle, and their owners as one number, when it last needed no
    # direction.
    settled: IntArray


@jit
def new_net(most: int) -> Net:
    """Return room for `most` directions."""
    return Net(
        np.zeros((most, 3)),
        np.zeros(most),
        np.full(most, SEAM, dtype=np.int64),
        np.zeros((2 * most, 3), dtype=np.int64),
        np.zeros((2 * most, 3), dtype=np.int64),
        np.zeros(4 * most, dtype=np.int64),
        np.full((2 * most, 4), -1, dtype=np.int64),
    )


@jit
def unit(d: FloatArray) -> None:
    """Make a direction a unit vector, in place."""
    d /= sqrt(np.sum(d * d))


@jit
def blur(d: FloatArray, number: int) -> None:
    """Move a direction a little, in place.

    Rings of symmetric junctions are in line, where rounding leaves their order open; places of
    vertices stay.
    """
    for axis in range(3):
        d[axis] += LIMITS.blur * sin(12.9898 * number + 78.233 * axis + 1.0)
    unit(d)


@jit
def inserted(net: Net, begin: int, end: int, used: int) -> int:
    """Put directions into the triangles; return how many those are, below 0 where that fails."""
    for p in range(begin, end):
        used = insert(net.d, p, net.tri, net.beside, used, net.stack)
        if used < 0:
            break
    return used


@jit
def gap(net: Net, p: int, q: int) -> float:
    """Distance of two points of the surface, mm."""
    square = 0.0
    for axis in range(3):
        square += (net.away[p] * net.d[p, axis] - net.away[q] * net.d[q, axis]) ** 2
    return sqrt(square)


@jit
def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@jit
def _above(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    height = nx * (d[0] - a[0]) + ny * (d[1] - a[1]) + nz * (d[2] - a[2])
    return height > LIMITS.flat * sqrt(nx * nx + ny * ny + nz * nz)


@jit
def start(
    points: FloatArray, count: int, tri: IntArray, beside: IntArray, chosen: IntArray
) -> bool:
    """Make four triangles of the four of the first ``count`` points that best hold the centre.

    They are written to ``chosen`` (4,). False where no four hold it well.
    """
    best = 0.0
    for i in range(count):
        for j in range(i):
            for k in range(j):
                whole = _turn(points[i], points[j], points[k])
                side = 1.0 if whole > 0.0 else -1.0
                for m in range(k):
                    # The centre is inside when it sees all four faces from within.
                    one = -side * _turn(points[m], points[j], points[k])
                    two = -side * _turn(points[i], points[m], points[k])
                    three = -side * _turn(points[i], points[j], points[m])
                    least = min(min(one, two), min(three, abs(whole)))
                    if least > best:
                        best = least
                        chosen[0], chosen[1], chosen[2], chosen[3] = m, k, j, i
    if best < 1e-3:
        return False
    zero, one, two, three = chosen[0], chosen[1], chosen[2], chosen[3]
    if _turn(points[zero], points[one], points[two]) < 0.0:
        one, two = two, one
    corners = ((zero, one, two), (zero, three, one), (one, three, two), (two, three, zero))
    for t in range(4):
        for k in range(3):
            tri[t, k] = corners[t][k]
    for t in range(4):
        for k in range(3):
            a, b = tri[t, (k + 1) % 3], tri[t, (k + 2) % 3]
            for o in range(4):
                for e in range(3):
                    if tri[o, (e + 1) % 3] == b and tri[o, (e + 2) % 3] == a:
                        beside[t, k] = o
    return True


@jit
def _locate(points: FloatArray, p: int, tri: IntArray, beside: IntArray, last: int) -> int:
    t = last
    for step in range(3000):
        moved = False
        for turn in range(3):
            k = (turn + step) % 3
            a, b = tri[t, (k + 1) % 3], tri[t, (k + 2) % 3]
            if _turn(points[a], points[b], points[p]) < -LIMITS.on_edge:
                t = beside[t, k]
                moved = True
                break
        if not moved:
            return t
    return -1


@jit
def _replace(beside: IntArray, t: int, old: int, new: int) -> None:
    for k in range(3):
        if beside[t, k] == old:
            beside[t, k] = new


@jit
def insert(
    points: FloatArray, p: int, tri: IntArray, beside: IntArray, used: int, stack: IntArray
) -> int:
    """Insert point ``p``; return how many triangles there are then.

    -1 where ``p`` can't be placed (NaN, or points that rounding can't tell from an edge). Arrays
    must have room for two more.
    """
    t = _locate(points, p, tri, beside, used - 1)
    if t < 0:
        return -1
    for k in range(3):
        near = 0.0
        for axis in range(3):
            near += (points[p, axis] - points[tri[t, k], axis]) ** 2
        if near < LIMITS.same * LIMITS.same:
            return used
    a, b, c = tri[t, 0], tri[t, 1], tri[t, 2]
    na, nb, nc = beside[t, 0], beside[t, 1], beside[t, 2]
    t1, t2 = used, used + 1
    tri[t, 0], tri[t, 1], tri[t, 2] = a, b, p
    tri[t1, 0], tri[t1, 1], tri[t1, 2] = b, c, p
    tri[t2, 0], tri[t2, 1], tri[t2, 2] = c, a, p
    beside[t, 0], beside[t, 1], beside[t, 2] = t1, t2, nc
    beside[t1, 0], beside[t1, 1], beside[t1, 2] = t2, t, na
    beside[t2, 0], beside[t2, 1], beside[t2, 2] = t, t1, nb
    _replace(beside, na, t, t1)
    _replace(beside, nb, t, t2)
    stack[0], stack[1], stack[2] = t, t1, t2
    top, flips = 3, 0
    while top > 0:
        top -= 1
        t = stack[top]
        o = beside[t, 2]
        e = 0
        while e < 3 and beside[o, e] != t:
            e += 1
        if e == 3:
            return -1
        a, b, d = tri[t, 0], tri[t, 1], tri[o, e]
        # A point on an edge makes a triangle without area, which goes whatever lies beyond.
        flips += 1
        if flips > LIMITS.flips:
            return -1
        flat = (
            _turn(points[a], points[b], points[p]) <= LIMITS.on_edge
            and _turn(points[a], points[d], points[p]) > LIMITS.on_edge
            and _turn(points[d], points[b], points[p]) > LIMITS.on_edge
        )
        if not flat and not _above(points[a], points[b], points[p], points[d]):
            continue
        # o is (d, b, a): the two become (a, d, p) and (d, b, p).
        over_bd, over_da = beside[o, (e + 2) % 3], beside[o, (e + 1) % 3]
        over_bp, over_pa = beside[t, 0], beside[t, 1]
        tri[t, 0], tri[t, 1], tri[t, 2] = a, d, p
        tri[o, 0], tri[o, 1], tri[o, 2] = d, b, p
        beside[t, 0], beside[t, 1], beside[t, 2] = o, over_pa, over_da
        beside[o, 0], beside[o, 1], beside[o, 2] = over_bp, t, over_bd
        _replace(beside, over_da, o, t)
        _replace(beside, over_bp, t, o)
        stack[top], stack[top + 1] = t, o
        top += 2
    return used + 2
