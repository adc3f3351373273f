"""By rays from a junction's centre, find the outermost vessel and the wall clear of fillets."""

from __future__ import annotations

from math import sqrt

import numpy as np

from design.solids.smooth.fillet import leaves, wall_distance
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@jit
def owner(walls: FloatArray, dx: float, dy: float, dz: float) -> int:
    """Vessel that a ray from the junction's middle leaves last."""
    far, vessel = -1.0, 0
    for i in range(len(walls)):
        t = leaves(walls[i], dx, dy, dz)
        if t > far:
            far, vessel = t, i
    return vessel


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
def first_clear(walls: FloatArray, one: int, rho: float, across: FloatArray, reach: float) -> float:
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
def at_ring(
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
