"""Merge extruding moves shorter than the firmware's planner accepts, with least corner cutting.

Marlin drops a block of fewer than its least steps and adds it to the next one: a corner is cut
where the firmware likes. Here those vertices stay that leave moves long enough and cut off least
in all. Positions and E are absolute, so dropping a vertex loses neither place nor ink.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import FloatArray, IntArray

#: Vertices left out one after the other stand along at most so many least moves, given a choice.
LONGEST = 10.0


@jit
def _steps(a: FloatArray, b: FloatArray) -> float:
    most = 0.0
    for axis in range(4):
        most = max(most, abs(b[axis] - a[axis]))
    return most


@jit
def _cut(position: FloatArray, begin: int, end: int, most: float) -> float:
    """What a stretch from one vertex to a later one cuts off, steps³; it may stop beyond ``most``.

    Squared distances of the vertices between, XYZ, times half of the way beside them.
    """
    a, c = position[begin], position[end]
    length = total = 0.0
    for k in range(3):
        length += (c[k] - a[k]) ** 2
    for v in range(begin + 1, end):
        b = position[v]
        along = beside = 0.0
        for k in range(3):
            along += (b[k] - a[k]) * (c[k] - a[k])
            beside += abs(b[k] - position[v - 1][k]) + abs(b[k] - position[v + 1][k])
        share = min(1.0, max(0.0, along / length)) if length > 0 else 0.0
        for k in range(3):
            total += 0.5 * beside * (b[k] - a[k] - share * (c[k] - a[k])) ** 2
        if total > most:
            break
    return total


@jit
def _merge(
    position: FloatArray, begin: int, end: int, least: float, keep: NDArray[np.bool_]
) -> None:
    """Choose the vertices of a run that cut off least in all, from its first to its last."""
    best = np.full(end - begin + 1, np.inf)
    before = np.zeros(end - begin + 1, np.int64)
    best[0] = 0.0
    for v in range(begin + 1, end + 1):
        way = 0.0
        for u in range(v - 1, begin - 1, -1):
            if u + 2 < v:
                way += _steps(position[u + 1], position[u + 2])
            if way > LONGEST * least and best[v - begin] < np.inf:
                break
            if best[u - begin] == np.inf or _steps(position[u], position[v]) < least:
                continue
            lost = _cut(position, u, v, best[v - begin])
            if best[u - begin] + lost < best[v - begin]:
                best[v - begin], before[v - begin] = best[u - begin] + lost, u - begin
    keep[begin : end - 1] = False
    v = before[end - begin]  # 0 where the run as a whole is too short
    while v > 0:
        keep[begin + v - 1] = True
        v = before[v]


@jit
def _keep(position: FloatArray, run: IntArray, least: float) -> NDArray[np.bool_]:
    """Whether each move's end stays; ``position`` (n + 1, 4) in steps, run -1 isn't merged."""
    keep = np.ones(len(run), np.bool_)
    begin, short = 0, False  # move k goes from vertex k to vertex k + 1
    for k in range(len(run)):
        if k > 0 and run[k] != run[k - 1]:
            begin, short = k, False
        short = short or _steps(position[k], position[k + 1]) < least
        if short and run[k] >= 0 and (k + 1 == len(run) or run[k + 1] != run[k]):
            _merge(position, begin, k + 1, least, keep)
    return keep


def long_enough(position_steps: FloatArray, run: IntArray, least_steps: float) -> NDArray[np.bool_]:
    """Which moves' end points to keep so that no move of a run is shorter than the least.

    Parameters
    ----------
    position_steps : (n + 1, 4) float64, motor steps
        X, Y, Z and E before the first move and after each.
    run : (n,) int64
        Number of the run of moves that may merge with each other; -1 for a move that stays.
    least_steps : float
        The longest axis counts, as in Marlin. A run shorter than this as a whole stays one
        short move.
    """
    return _keep(np.ascontiguousarray(position_steps), run, least_steps)
