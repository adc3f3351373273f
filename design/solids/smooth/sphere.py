"""Delaunay triangulation of points on the unit sphere, by inserting one point at a time.

Points are put in one after another: the triangle around a new one is parted in three, and edges
are flipped while a neighbour's far corner stands over the plane of a triangle (Lawson 1977). On
the sphere that is the same as lying in its circumcircle.
"""

from __future__ import annotations

from math import sqrt

from kernels import jit
from kernels.arrays import FloatArray, IntArray

_FLAT = 1e-12
"""Height over a triangle's plane that is no height: points of one ring lie on one circle."""

_ON_EDGE = 1e-15
"""Determinants of directions below it are rounding."""

_SAME = 3e-4
"""Points nearer than that to a corner around them are left out."""

_MOST_FLIPS = 2000
"""After one point; a handful is usual, and rounding could make them go on for ever."""


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
    return height > _FLAT * sqrt(nx * nx + ny * ny + nz * nz)


@jit
def start(
    points: FloatArray, count: int, tri: IntArray, beside: IntArray, chosen: IntArray
) -> bool:
    """First four triangles, from the four of the first ``count`` points that best hold the centre.

    ``chosen`` (4,) is filled with them. False where no four hold it well.
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
            if _turn(points[a], points[b], points[p]) < -_ON_EDGE:
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
    """Put point ``p`` into the triangulation; returns how many triangles there are then.

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
        if near < _SAME * _SAME:
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
        if flips > _MOST_FLIPS:
            return -1
        flat = (
            _turn(points[a], points[b], points[p]) <= _ON_EDGE
            and _turn(points[a], points[d], points[p]) > _ON_EDGE
            and _turn(points[d], points[b], points[p]) > _ON_EDGE
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
