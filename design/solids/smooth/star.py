"""Triangulate the rounded wall of one vessel junction by rays from its centre.

All vessels of a junction hold its point and are convex, so their union is star-shaped about it, and
so is its closing by a ball: each direction meets the surface once. Triangles of directions, drawn
out to the surface, are therefore closed, oriented and free of self-intersection whatever the
vessels are; what remains is to put directions where the surface bends.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from design.solids.smooth.fillet import rounded_distance, shoot, wall_distance
from design.solids.smooth.layout import across_axis
from design.solids.smooth.sphere import (
    CAP,
    LIMITS,
    SEAM,
    Junction,
    Net,
    blur,
    gap,
    insert,
    inserted,
    new_net,
    owner,
    start,
    unit,
)
from kernels import jit
from kernels.arrays import FloatArray, IntArray


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
    """Triangulate one junction between the first rings of its tubes.

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
    junction, net = Junction(walls, rho, reach, rings, ring_of, tolerance, least), new_net(most)
    first = len(rings)
    rings_in(junction, net)
    count = cover_in(junction, net)
    used = start_triangles(net, first, count)
    if used < 0:
        return -used, rings, net.tri[:0]
    shoot(walls, rho, net.d[first:count], net.away[first:count])
    count, used = seams_in(junction, net, count, used)
    status = 0
    for _ in range(LIMITS.rounds):
        if used < 0 or status:
            break
        begin = count
        count, full = refine_directions(junction, net, count, used)
        status = 2 if full else 0
        if count == begin:
            break
        shoot(walls, rho, net.d[begin:count], net.away[begin:count])
        used = inserted(net, begin, count, used)
    if used < 0:
        return 3, rings, net.tri[:0]
    points, faces = _without_caps(junction, net, count, used)
    return status, points, faces


@jit
def _without_caps(
    junction: Junction, net: Net, count: int, used: int
) -> tuple[FloatArray, IntArray]:
    """Return points and faces without those of the axes; the rings' points first, as given."""
    rings = junction.rings
    faces = np.empty((used, 3), dtype=np.int64)
    points = np.empty((count, 3))
    points[: len(rings)] = rings
    place_of = np.full(count, -1, dtype=np.int64)
    place_of[: len(rings)] = np.arange(len(rings))
    kept, placed = 0, len(rings)
    for t in range(used):
        if net.owner[net.tri[t]].min() == CAP:
            continue
        for k in range(3):
            p = net.tri[t, k]
            if place_of[p] < 0:
                place_of[p] = placed
                for axis in range(3):
                    points[placed, axis] = junction.walls[0, axis] + net.away[p] * net.d[p, axis]
                placed += 1
            faces[kept, k] = place_of[p]
        kept += 1
    return points[:placed], faces[:kept]


@jit
def _line_clear(walls: FloatArray, one: int, rho: float, across: FloatArray, x: float) -> bool:
    """Return whether the ball touches a wall line of vessel ``one`` at ``x`` and no other."""
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
def first_clear(walls: FloatArray, one: int, rho: float, across: FloatArray, reach: float) -> float:
    """Find the least x from which the wall line in direction ``across`` is free to ``reach``."""
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
def at_ring(
    walls: FloatArray, reach: FloatArray, e: FloatArray, d: FloatArray, ring_of: IntArray
) -> bool:
    """Return whether a direction goes through a tube's first ring, or so near that it breaks it.

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
def rings_in(junction: Junction, net: Net) -> None:
    """Put in the directions of all rings, first of all."""
    for r in range(len(junction.rings)):
        net.d[r] = junction.rings[r] - junction.walls[0, :3]
        net.away[r] = sqrt(np.sum(net.d[r] ** 2))
        net.owner[r] = junction.ring_of[r]
        net.d[r] /= net.away[r]
        blur(net.d[r], r)


@jit
def cover_in(junction: Junction, net: Net) -> int:
    """Put in the axes and an even cover, for the side without vessels; return how many are in."""
    walls, reach, d = junction.walls, junction.reach, net.d
    count = len(junction.rings)
    for i in range(len(walls)):
        # A little off the axis: on it, it would be in line with each two opposite vertices.
        side = across_axis(walls[i, 3:6])
        wide = 0.1 * (walls[i, 7] + walls[i, 8] * reach[i]) / reach[i]
        d[count] = walls[i, 3:6] + wide * side[0] + 0.37 * wide * side[1]
        unit(d[count])
        net.owner[count] = CAP
        count += 1
    # Fibonacci's spiral, turned off the axes.
    for k in range(LIMITS.cover):
        z = 1.0 - (2.0 * k + 1.0) / LIMITS.cover
        angle = 2.399963229728653 * k + 0.3
        across = sqrt(1.0 - z * z)
        d[count, 0], d[count, 1], d[count, 2] = across * cos(angle), across * sin(angle), z
        if not at_ring(walls, reach, d[count], d, junction.ring_of):
            net.owner[count] = owner(walls, d[count, 0], d[count, 1], d[count, 2])
            count += 1
    return count


@jit
def start_triangles(net: Net, first: int, count: int) -> int:
    """Return how many triangles `count` directions make, the rings' being the first `first`.

    -1 where directions don't surround the middle, -3 where rounding blurs their order.
    """
    chosen = np.zeros(4, dtype=np.int64)
    if not start(net.d[first:count], count - first, net.tri, net.beside, chosen):
        return -1
    net.tri[:4] += first
    used = 4
    # The axes and the cover first: they aren't in line with one another as a ring's are.
    for p in range(first, count):
        if not np.any(chosen == p - first):
            used = insert(net.d, p, net.tri, net.beside, used, net.stack)
            if used < 0:
                return -3
    used = inserted(net, 0, first, used)
    return used if used >= 0 else -3


@jit
def seams_in(junction: Junction, net: Net, count: int, used: int) -> tuple[int, int]:
    """Put in where wall lines meet other walls or fillets; return how many, and triangles."""
    for r in range(len(junction.rings)):
        if count < len(net.d) and _seam_of(junction, net, r, count):
            used = insert(net.d, count, net.tri, net.beside, used, net.stack)
            count += 1
            if used < 0:
                break
    return count, used


@jit
def _seam_of(junction: Junction, net: Net, r: int, count: int) -> bool:
    """Write direction `count`: where a ring point's wall line ends. False where there is none."""
    walls, i = junction.walls, junction.ring_of[r]
    length = junction.reach[i]
    across = junction.rings[r] - walls[i, :3] - length * walls[i, 3:6]
    unit(across)
    x = first_clear(walls, i, junction.rho, across, length)
    if x >= length - junction.least:
        return False
    radius = walls[i, 7] + walls[i, 8] * x
    net.d[count] = x * walls[i, 3:6] + radius * across
    unit(net.d[count])
    blur(net.d[count], count)
    if at_ring(walls, junction.reach, net.d[count], net.d, junction.ring_of):
        return False
    shoot(walls, junction.rho, net.d[count : count + 1], net.away[count : count + 1])
    net.owner[count] = SEAM if (junction.rho > 0.0 or x > 0.0) else i
    return True


@jit
def refine_directions(junction: Junction, net: Net, count: int, used: int) -> tuple[int, bool]:
    """Add directions where triangles leave the surface; return how many there are, and if full."""
    for t in range(used):
        a, b, c = net.tri[t, 0], net.tri[t, 1], net.tri[t, 2]
        if net.owner[a] == CAP or net.owner[b] == CAP or net.owner[c] == CAP:
            continue
        if count + 4 >= len(net.d):
            return count, True
        if max(gap(net, a, b), gap(net, b, c), gap(net, c, a)) < junction.least:
            continue
        if _is_settled(net, t):
            continue
        before = count
        if junction.rho <= 0.0:
            for k in range(3):
                count = _parted_edge(junction, net, net.tri[t, k], net.tri[t, (k + 1) % 3], count)
        if count == before:
            count = _parted_middle(junction, net, t, count)
        if count == before:
            _settle(net, t)
    return count, False


@jit
def _owners(net: Net, t: int) -> int:
    """Owners of a triangle's corners as one number."""
    a, b, c = net.tri[t, 0], net.tri[t, 1], net.tri[t, 2]
    return int((net.owner[a] << 32) ^ (net.owner[b] << 16) ^ net.owner[c])


@jit
def _is_settled(net: Net, t: int) -> bool:
    """Return whether a triangle is as it was when it last needed no direction."""
    for k in range(3):
        if net.settled[t, k] != net.tri[t, k]:
            return False
    return net.settled[t, 3] == _owners(net, t)


@jit
def _settle(net: Net, t: int) -> None:
    """Record that a triangle needs no direction as long as its corners and owners stay."""
    for k in range(3):
        net.settled[t, k] = net.tri[t, k]
    net.settled[t, 3] = _owners(net, t)


@jit
def _parted_middle(junction: Junction, net: Net, t: int, count: int) -> int:
    """Add a triangle's middle where it lies off the surface; return how many there are."""
    a, b, c = net.tri[t, 0], net.tri[t, 1], net.tri[t, 2]
    walls, d = junction.walls, net.d
    m = (net.away[a] * d[a] + net.away[b] * d[b] + net.away[c] * d[c]) / 3.0
    off = rounded_distance(
        walls, junction.rho, m[0] + walls[0, 0], m[1] + walls[0, 1], m[2] + walls[0, 2]
    )
    if abs(off) > junction.tolerance:
        unit(m)
        if not at_ring(walls, junction.reach, m, d, junction.ring_of):
            d[count] = m
            net.owner[count] = owner(walls, m[0], m[1], m[2])
            count += 1
    return count


@jit
def _parted_edge(junction: Junction, net: Net, p: int, q: int, count: int) -> int:
    """Add where an edge between two sharp walls crosses their seam; return how many there are."""
    whose = net.owner
    if p > q or whose[p] == SEAM or whose[q] == SEAM or whose[p] == whose[q]:
        return count
    if gap(net, p, q) < junction.least:
        return count
    low = _seam_on(junction, net, p, q)
    rings = len(junction.rings)
    if 0.02 < low < 0.98 and count < len(net.d):
        net.d[count] = (1.0 - low) * net.d[p] + low * net.d[q]
        unit(net.d[count])
        if not at_ring(junction.walls, junction.reach, net.d[count], net.d, junction.ring_of):
            whose[count] = SEAM
            count += 1
    elif low <= 0.02 and p >= rings:
        whose[p] = SEAM
    elif low >= 0.98 and q >= rings:
        whose[q] = SEAM
    return count


@jit
def _seam_on(junction: Junction, net: Net, p: int, q: int) -> float:
    """Find the share of the way from direction `p` to `q` at which another wall begins."""
    low, high = 0.0, 1.0
    for _ in range(40):
        half = 0.5 * (low + high)
        e = (1.0 - half) * net.d[p] + half * net.d[q]
        unit(e)
        if owner(junction.walls, e[0], e[1], e[2]) == net.owner[p]:
            low = half
        else:
            high = half
    return low
