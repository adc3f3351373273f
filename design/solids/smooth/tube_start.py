"""Compute the distance from a junction at which each vessel becomes a plain tube."""

from __future__ import annotations

from math import cos, inf, pi, sin, sqrt

import numpy as np

from design.solids.smooth.fillet import wall_distance
from kernels import jit
from kernels.arrays import FloatArray

_AROUND = 24
"""Places around a vessel at which its wall is tried."""

_LEAST = 0.5
"""Radii between a junction and the first ring of a tube."""

_BEYOND = 0.2
"""Radii between a fillet's rim and that ring, in which triangles get from one to the other."""


@jit
def _bound(walls: FloatArray, one: int, rho: float) -> float:
    """A distance beyond which no other vessel's ball can touch this one's wall (if they part)."""
    bound = 0.0
    for other in range(len(walls)):
        if other == one:
            continue
        c = 0.0
        for k in range(3, 6):
            c += walls[one, k] * walls[other, k]
        both = walls[one, 7] + walls[other, 7] + 3.0 * rho
        if c > 0.0:
            across = sqrt(max(0.0, 1.0 - c * c))
            both = both / across if across > 1e-3 else inf
        bound = max(bound, both)
    return 1.2 * bound + walls[one, 7]


@jit
def _holds_another(walls: FloatArray, one: int, x: float) -> bool:
    """Whether at ``x`` another vessel's axis is still within this one's wall."""
    for other in range(len(walls)):
        c = 0.0
        for k in range(3, 6):
            c += walls[one, k] * walls[other, k]
        if other != one and c > 0.0:
            across = x * sqrt(max(0.0, 1.0 - c * c)) / c
            if across < walls[one, 7] + walls[one, 8] * x:
                return True
    return False


@jit
def _clear(walls: FloatArray, one: int, rho: float, x: float, frame: FloatArray) -> bool:
    """Whether at ``x`` along the axis the ball touches this vessel's wall all around.

    A vessel that is still inside will come through the wall farther out.
    """
    if _holds_another(walls, one, x):
        return False
    wall = walls[one]
    radius = wall[7] + wall[8] * x
    margin = 0.02 * radius
    for k in range(_AROUND):
        angle = 2.0 * pi * k / _AROUND
        c, s = cos(angle), sin(angle)
        place = np.empty(3)
        for axis in range(3):
            across = c * frame[0, axis] + s * frame[1, axis]
            normal = wall[9] * (across - wall[8] * wall[3 + axis])
            foot = wall[axis] + x * wall[3 + axis]
            place[axis] = foot + radius * across + (rho + margin) * normal
        for other in range(len(walls)):
            if other != one:
                a, _, _, _ = wall_distance(walls[other], place[0], place[1], place[2])
                if a < rho + margin:
                    return False
    return True


@jit
def _clear_from(walls: FloatArray, one: int, rho: float, room: float) -> float:
    """Least distance along vessel ``one`` from which on no other vessel's fillet touches it.

    Walked inwards from where it is certain, as a thin vessel may leave a wide one's wall late.
    """
    radius = walls[one, 7]
    least, beyond = _LEAST * radius, _BEYOND * radius
    bound = _bound(walls, one, rho)
    x = min(room - beyond, bound)
    frame = across_axis(walls[one, 3:6])
    if x < bound and _holds_another(walls, one, x):
        return inf
    if not least <= x < inf or not _clear(walls, one, rho, x, frame):
        return inf
    step = max(0.1 * radius, 0.05 * (x - least))
    while step > 0.09 * radius:
        while x - step > least and _clear(walls, one, rho, x - step, frame):
            x -= step
        step *= 0.4
    return x + beyond


@jit
def across_axis(axis: FloatArray) -> FloatArray:
    """Two unit vectors across ``axis``, (2, 3)."""
    helper = np.zeros(3)
    helper[np.argmin(np.abs(axis))] = 1.0
    frame = np.empty((2, 3))
    frame[0] = np.cross(helper, axis)
    frame[0] /= sqrt(np.sum(frame[0] ** 2))
    frame[1] = np.cross(axis, frame[0])
    return frame


@jit
def reaches(walls: FloatArray, rho: float, room: FloatArray) -> FloatArray:
    """Distance along each vessel of a junction at which it is a plain tube again, (n,), mm.

    Infinite where it isn't within ``room`` (n,). See `wall_rows` for ``walls``.
    """
    distances = np.empty(len(walls))
    for one in range(len(walls)):
        distances[one] = _clear_from(walls, one, rho, room[one])
    return distances
