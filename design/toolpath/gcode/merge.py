"""Merge extruding moves that are too short for the firmware's planner.

Marlin drops a block of fewer than its least steps and adds it to the next one: a corner is cut
where the firmware likes. Here the vertex is dropped whose loss bends the path least. Positions
and E are absolute, so dropping a vertex loses neither place nor ink.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit


@jit
def _steps(a: FloatArray, b: FloatArray) -> float:
    most = 0.0
    for axis in range(4):
        most = max(most, abs(b[axis] - a[axis]))
    return most


@jit
def _bend(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Squared distance in steps of b from the stretch a to c, XYZ."""
    along = length = 0.0
    for k in range(3):
        along += (b[k] - a[k]) * (c[k] - a[k])
        length += (c[k] - a[k]) ** 2
    share = min(1.0, max(0.0, along / length)) if length > 0 else 0.0
    total = 0.0
    for k in range(3):
        total += (b[k] - a[k] - share * (c[k] - a[k])) ** 2
    return total


@jit
def _keep(position: FloatArray, run: IntArray, least: float) -> NDArray[np.bool_]:
    """Whether each move's end stays; ``position`` (n + 1, 4) in steps, run -1 isn't merged."""
    count = len(run)
    keep = np.ones(count, np.bool_)
    last, before = 0, -1  # vertices: move k goes from vertex k to vertex k + 1
    for k in range(count):
        v = k + 1
        if run[k] < 0 or (k > 0 and run[k] != run[k - 1]):
            last, before = k, -1
        if run[k] < 0 or _steps(position[last], position[v]) >= least:
            before, last = last, v
            continue
        if k + 1 == count or run[k + 1] != run[k]:
            # The end of a run stays; the vertex before it goes, when it isn't the run's start.
            if before >= 0:
                keep[last - 1] = False
                last = v
        elif (
            before >= 0
            and _steps(position[before], position[v]) >= least
            and _bend(position[before], position[last], position[v])
            < _bend(position[last], position[v], position[v + 1])
        ):
            keep[last - 1] = False
            last = v
        else:
            keep[k] = False
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
