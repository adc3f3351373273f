"""Fewer, longer moves along walls, never nearer to a boundary.

Firmware merges moves shorter than its least, and cuts the corner into the lumen where it likes.
Here a short move goes by its two neighbours being drawn out until they meet, where the path bends
round a lumen, or by leaving out a point, where it bends the other way. Both put the path on the
side of the material, so that the circle inside a lumen stays as wide as it was.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.paths import Paths, Role
from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit

#: How far a path may leave its place, in line widths.
TOLERANCE = 0.3
#: Rounds over a path; each takes at most every other short move away.
ROUNDS = 12


def without_short_moves(paths: Paths, least_mm: float, width_mm: float) -> Paths:
    """Take moves shorter than ``least_mm`` out of the walls, where `TOLERANCE` lets that be.

    Parameters
    ----------
    paths : Paths
        Walls have the material's inside on their left.
    least_mm : float, mm
        Along the longer of x and y, which is what a firmware counts; 0 leaves all as it is.
    width_mm : float, mm
        Of a line.
    """
    if least_mm <= 0 or len(paths) == 0:
        return paths
    points, keep = _coarsened(
        paths.points.copy(),
        paths.offset,
        paths.closed,
        paths.role == Role.WALL,
        least_mm,
        TOLERANCE * width_mm,
    )
    total = np.concatenate([[0], np.cumsum(keep)])
    return replace(
        paths, points=points[keep], width_mm=paths.width_mm[keep], offset=total[paths.offset]
    )


@jit
def _bend(points: FloatArray, a: int, b: int, c: int) -> float:
    """How far b stands to the right of the way from a to c; below 0 for the left."""
    x, y = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    length = math.sqrt(x * x + y * y)
    if length == 0:
        return 0.0
    bend: float = (x * (points[a, 1] - points[b, 1]) - y * (points[a, 0] - points[b, 0])) / length
    return bend


@jit
def _drawn_out(
    points: FloatArray, a: int, b: int, c: int, d: int, most: float
) -> tuple[bool, float, float]:
    """Where the ways a to b and d to c meet beyond b and c, when that is near enough."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    cross = ux * vy - uy * vx
    if abs(cross) < 1e-15:
        return False, 0.0, 0.0
    wx, wy = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1]
    s, t = (wx * vy - wy * vx) / cross, (wx * uy - wy * ux) / cross
    if s < 1 or t < 1:
        return False, 0.0, 0.0
    x, y = points[a, 0] + s * ux, points[a, 1] + s * uy
    ex, ey = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1]
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0:
        return False, 0.0, 0.0
    off = abs(ex * (y - points[b, 1]) - ey * (x - points[b, 0])) / length
    return off <= most, x, y


@jit
def _coarsened(
    points: FloatArray,
    offset: IntArray,
    closed: NDArray[np.bool_],
    wall: NDArray[np.bool_],
    least: float,
    most: float,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    keep = np.ones(len(points), np.bool_)
    after, before = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for p in range(len(closed)):
        low, high = offset[p], offset[p + 1]
        left = high - low
        if not wall[p] or left < 4:
            continue
        for k in range(low, high):
            after[k], before[k] = k + 1, k - 1
        after[high - 1], before[low] = low, high - 1
        for _ in range(ROUNDS):
            changed = False
            for b in range(low, high):
                c = after[b]
                if not keep[b] or left < 4 or (not closed[p] and (b == low or c <= b)):
                    continue
                short = max(abs(points[c, 0] - points[b, 0]), abs(points[c, 1] - points[b, 1]))
                if short >= least or (not closed[p] and c == high - 1):
                    continue
                a, d = before[b], after[c]
                at_b, at_c = _bend(points, a, b, c), _bend(points, b, c, d)
                if at_b >= 0 and at_b <= most and (at_c < 0 or at_b <= at_c):
                    gone = b
                elif at_c >= 0 and at_c <= most:
                    gone = c
                elif at_b < 0 and at_c < 0:
                    met, x, y = _drawn_out(points, a, b, c, d, most)
                    if not met:
                        continue
                    points[b, 0], points[b, 1] = x, y
                    gone = c
                else:
                    continue
                keep[gone] = False
                after[before[gone]], before[after[gone]] = after[gone], before[gone]
                left -= 1
                changed = True
            if not changed:
                break
    return points, keep
