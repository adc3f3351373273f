"""Start a junction's triangulation by rays to tube rings, along axes and to seams (compiled)."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from design.solids.smooth.fillet import shoot
from design.solids.smooth.sphere import insert, start
from design.solids.smooth.star_net import CAP, SEAM, Junction, Net, blur, inserted, unit
from design.solids.smooth.star_rays import at_ring, first_clear, owner
from design.solids.smooth.tube_start import across_axis
from kernels import jit

_SCAFFOLD = 24
"""Directions of the even cover."""


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
    for k in range(_SCAFFOLD):
        z = 1.0 - (2.0 * k + 1.0) / _SCAFFOLD
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
