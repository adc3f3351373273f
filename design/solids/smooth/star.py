"""The surface around one junction, as seen from its middle.

All vessels of a junction hold its point and are convex, so their union is star-shaped about it, and
so is its closing by a ball: each direction meets the surface once. Triangles of directions, drawn
out to the surface, are therefore closed, oriented and free of self-intersection whatever the
vessels are; what remains is to put directions where the surface bends.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from design.solids.smooth.fillet import leaves, rounded_distance, shoot, wall_distance
from design.solids.smooth.reach import across_axis
from design.solids.smooth.sphere import insert, start
from kernels import jit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SEAM = -1
"""Owner of a point that lies on a seam, or on a fillet."""

CAP = -2
"""Owner of a vessel's axis, whose triangles are left out: there the tube goes on."""

_ROUNDS = 12
"""Of parting triangles; each takes the error down about threefold."""

_SCAFFOLD = 24
"""Directions of the even cover."""

_BLUR = 1e-7
"""Of directions in line; far below what moves a vertex by a float32 step."""


@jit
def _owner(walls: FloatArray, dx: float, dy: float, dz: float) -> int:
    """Vessel that a ray from the junction's middle leaves last."""
    far, found = -1.0, 0
    for i in range(len(walls)):
        t = leaves(walls[i], dx, dy, dz)
        if t > far:
            far, found = t, i
    return found


@jit
def _line_clear(walls: FloatArray, one: int, rho: float, across: FloatArray, x: float) -> bool:
    """Whether the ball touches a wall line of vessel ``one`` at ``x`` and no other vessel."""
    wall = walls[one]
    radius = wall[7] + wall[8] * x
    place = np.empty(3)
    for axis in range(3):
        normal = wall[9] * (across[axis] - wall[8] * wall[3 + axis])
        place[axis] = wall[axis] + x * wall[3 + axis] + radius * across[axis] + rho * normal
    for other in range(len(walls)):
        if other != one:
            a, _, _, _ = wall_distance(walls[other], place[0], place[1], place[2])
            if a < rho:
                return False
    return True


@jit
def _first_clear(
    walls: FloatArray, one: int, rho: float, across: FloatArray, reach: float
) -> float:
    """Least x from which the wall line in direction ``across`` is free up to ``reach``."""
    low, high = 0.0, reach
    step = 0.25 * min(walls[one, 7], reach)
    while True:
        x = max(0.0, high - step)
        if not _line_clear(walls, one, rho, across, x):
            low = x
            break
        high = x
        if x == 0.0:
            return 0.0
    for _ in range(30):
        x = 0.5 * (low + high)
        if _line_clear(walls, one, rho, across, x):
            high = x
        else:
            low = x
    return high


@jit
def _at_ring(
    walls: FloatArray, reach: FloatArray, e: FloatArray, d: FloatArray, ring_of: IntArray
) -> bool:
    """Whether a direction goes through the first ring of a tube, or so near that it breaks it.

    A ring's edge stays an edge of the triangulation while no point lies in the circle around it.
    """
    for i in range(len(walls)):
        c = e[0] * walls[i, 3] + e[1] * walls[i, 4] + e[2] * walls[i, 5]
        radius = walls[i, 7] + walls[i, 8] * reach[i]
        if c > 0.0 and sqrt(max(0.0, 1.0 - c * c)) * reach[i] <= radius * c:
            return True
    begin = 0
    for r in range(len(ring_of)):
        after = r + 1
        if after == len(ring_of) or ring_of[after] != ring_of[r]:
            after = begin
            begin = r + 1
        near, half = 0.0, 0.0
        for axis in range(3):
            near += (e[axis] - 0.5 * (d[r, axis] + d[after, axis])) ** 2
            half += (0.5 * (d[r, axis] - d[after, axis])) ** 2
        if near < 1.05 * half:
            return True
    return False


@jit
def star_mesh(
    walls: FloatArray,
    rho: float,
    reach: FloatArray,
    rings: FloatArray,
    ring_of: IntArray,
    tolerance: float,
    least: float,
    most: int,
) -> tuple[int, FloatArray, IntArray]:
    """Triangles of one junction between the first rings of its tubes.

    Parameters
    ----------
    walls : (n, 10) float64
    rho : float, mm
        Radius of the fillet; 0 for a sharp seam, which the triangles' edges then follow.
    reach : (n,) float64, mm
        Distance of each ring along its axis.
    rings : (r, 3) float64, mm
        Vertices of all rings; they come first among the points.
    ring_of : (r,) int64
        Which vessel's.
    tolerance : float, mm
        Greatest distance of a triangle's middle from the surface.
    least : float, mm
        Edges shorter than that aren't parted.
    most : int
        Points at most.

    Returns
    -------
    status : int
        0, or 1 where directions don't surround the middle, 2 where ``most`` isn't
        enough, 3 where rounding blurs the order of directions.
    points : (p, 3) float64, mm
        The rings' first.
    faces : (f, 3) int64
        Outward; their rim is the rings.
    """
    n, count = len(walls), len(rings)
    d = np.zeros((most, 3))
    away = np.zeros(most)
    owner = np.full(most, SEAM, dtype=np.int64)
    tri = np.zeros((2 * most, 3), dtype=np.int64)
    beside = np.zeros((2 * most, 3), dtype=np.int64)
    stack = np.zeros(4 * most, dtype=np.int64)
    chosen = np.zeros(4, dtype=np.int64)
    for r in range(count):
        size = 0.0
        for axis in range(3):
            d[r, axis] = rings[r, axis] - walls[0, axis]
            size += d[r, axis] ** 2
        away[r] = sqrt(size)
        owner[r] = ring_of[r]
        d[r] /= away[r]
        # Symmetric junctions have rings in line with one another, of which rounding makes a
        # muddle: for the order of directions (not for their places) they are a little off.
        for axis in range(3):
            d[r, axis] += _BLUR * sin(12.9898 * r + 78.233 * axis + 1.0)
        d[r] /= sqrt(np.sum(d[r] ** 2))
    first = count
    for i in range(n):
        # A little off the axis: on it, it would be in line with each two opposite vertices.
        side = across_axis(walls[i, 3:6])
        wide = 0.1 * (walls[i, 7] + walls[i, 8] * reach[i]) / reach[i]
        d[count] = walls[i, 3:6] + wide * side[0] + 0.37 * wide * side[1]
        d[count] /= sqrt(np.sum(d[count] ** 2))
        owner[count] = CAP
        count += 1
    # An even cover (Fibonacci's spiral, turned off the axes), for the side that has no vessel.
    for k in range(_SCAFFOLD):
        z = 1.0 - (2.0 * k + 1.0) / _SCAFFOLD
        angle = 2.399963229728653 * k + 0.3
        across = sqrt(1.0 - z * z)
        d[count, 0], d[count, 1], d[count, 2] = across * cos(angle), across * sin(angle), z
        if not _at_ring(walls, reach, d[count], d, ring_of):
            owner[count] = _owner(walls, d[count, 0], d[count, 1], d[count, 2])
            count += 1
    if not start(d[first:count], count - first, tri, beside, chosen):
        return 1, rings, tri[:0]
    tri[:4] += first
    used = 4
    for step in range(count):
        # The axes and the cover first: they aren't in line with one another as a ring's are.
        p = step + first if step < count - first else step - (count - first)
        if p < first or not np.any(chosen == p - first):
            used = insert(d, p, tri, beside, used, stack)
            if used < 0:
                return 3, rings, tri[:0]
    shoot(walls, rho, d[first:count], away[first:count])
    # Along each wall line the place where it meets the others, or their fillets.
    ring_count = first
    for r in range(ring_count):
        i = ring_of[r]
        across = rings[r] - walls[i, :3] - reach[i] * walls[i, 3:6]
        across /= sqrt(np.sum(across * across))
        x = _first_clear(walls, i, rho, across, reach[i])
        if count < most and x < reach[i] - least:
            radius = walls[i, 7] + walls[i, 8] * x
            place = x * walls[i, 3:6] + radius * across
            d[count] = place / sqrt(np.sum(place * place))
            for axis in range(3):
                d[count, axis] += _BLUR * sin(12.9898 * count + 78.233 * axis + 1.0)
            d[count] /= sqrt(np.sum(d[count] ** 2))
            if not _at_ring(walls, reach, d[count], d, ring_of):
                shoot(walls, rho, d[count : count + 1], away[count : count + 1])
                owner[count] = SEAM if (rho > 0.0 or x > 0.0) else i
                used = insert(d, count, tri, beside, used, stack)
                count += 1
                if used < 0:
                    return 3, rings, tri[:0]
    status = 0
    for _ in range(_ROUNDS):
        begin = count
        for t in range(used):
            a, b, c = tri[t, 0], tri[t, 1], tri[t, 2]
            if owner[a] == CAP or owner[b] == CAP or owner[c] == CAP:
                continue
            if count + 4 >= most:
                status = 2
                break
            pa, pb, pc = away[a] * d[a], away[b] * d[b], away[c] * d[c]
            longest = 0.0
            for k in range(3):
                one, two = pa, pb
                if k == 1:
                    one, two = pb, pc
                elif k == 2:
                    one, two = pc, pa
                gap = one - two
                longest = max(longest, sqrt(np.sum(gap * gap)))
            if longest < least:
                continue
            if rho <= 0.0:
                # Sharp: edges between two walls are parted where they cross the seam.
                before = count
                for k in range(3):
                    p, q = tri[t, k], tri[t, (k + 1) % 3]
                    if p > q or owner[p] == SEAM or owner[q] == SEAM or owner[p] == owner[q]:
                        continue
                    gap = away[p] * d[p] - away[q] * d[q]
                    if sqrt(np.sum(gap * gap)) < least:
                        continue
                    low, high = 0.0, 1.0
                    for _ in range(40):
                        half = 0.5 * (low + high)
                        e = (1.0 - half) * d[p] + half * d[q]
                        e /= sqrt(np.sum(e * e))
                        if _owner(walls, e[0], e[1], e[2]) == owner[p]:
                            low = half
                        else:
                            high = half
                    if 0.02 < low < 0.98 and count < most:
                        d[count] = (1.0 - low) * d[p] + low * d[q]
                        d[count] /= sqrt(np.sum(d[count] * d[count]))
                        if not _at_ring(walls, reach, d[count], d, ring_of):
                            owner[count] = SEAM
                            count += 1
                    elif low <= 0.02 and p >= ring_count:
                        owner[p] = SEAM
                    elif low >= 0.98 and q >= ring_count:
                        owner[q] = SEAM
                if count > before:
                    continue
            m = (pa + pb + pc) / 3.0
            off = rounded_distance(
                walls, rho, m[0] + walls[0, 0], m[1] + walls[0, 1], m[2] + walls[0, 2]
            )
            if abs(off) > tolerance:
                e = m / sqrt(np.sum(m * m))
                if not _at_ring(walls, reach, e, d, ring_of):
                    d[count] = e
                    owner[count] = _owner(walls, e[0], e[1], e[2])
                    count += 1
        if count == begin:
            break
        shoot(walls, rho, d[begin:count], away[begin:count])
        for p in range(begin, count):
            used = insert(d, p, tri, beside, used, stack)
            if used < 0:
                return 3, rings, tri[:0]
        if status:
            break
    faces = np.empty((used, 3), dtype=np.int64)
    kept = 0
    place_of = np.full(count, -1, dtype=np.int64)
    place_of[:ring_count] = np.arange(ring_count)
    points = np.empty((count, 3))
    points[:ring_count] = rings
    placed = ring_count
    for t in range(used):
        a, b, c = tri[t, 0], tri[t, 1], tri[t, 2]
        if owner[a] == CAP or owner[b] == CAP or owner[c] == CAP:
            continue
        for k in range(3):
            p = tri[t, k]
            if place_of[p] < 0:
                place_of[p] = placed
                for axis in range(3):
                    points[placed, axis] = walls[0, axis] + away[p] * d[p, axis]
                placed += 1
            faces[kept, k] = place_of[p]
        kept += 1
    return status, points[:placed], faces[:kept]
