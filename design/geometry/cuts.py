"""Split one node of a bounding volume hierarchy by the surface area heuristic (compiled)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kernels import jit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BINS = 16
"""Bins along each axis, between which cuts are compared."""


@jit
def _take_in(box: FloatArray, other: FloatArray) -> None:
    """Widen a box to hold another."""
    for c in range(3):
        box[c] = min(box[c], other[c])
        box[3 + c] = max(box[3 + c], other[3 + c])


@jit
def _empty(count: int) -> FloatArray:
    """Return boxes (count, 6) around nothing."""
    out = np.full((count, 6), np.inf)
    out[:, 3:] = -np.inf
    return out


@jit
def enclosing_box(own: FloatArray, chosen: IntArray) -> FloatArray:
    """Box around the boxes of chosen members, (6,)."""
    out = _empty(1)[0]
    for t in chosen:
        _take_in(out, own[t])
    return out


@jit
def _faces(box: FloatArray) -> float:
    """Half the surface of a box: how often a search comes to it, in proportion."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return float(x * y + y * z + z * x)


@jit
def partition_members(own: FloatArray, chosen: IntArray, cheapest: bool) -> int:
    """Put members of the first child before those of the second; return how many it has.

    Cut where it is cheapest, else in the middle of the order they are in.
    """
    axis, last = _cheapest_cut(own, chosen) if cheapest else (-1, 0)
    if axis < 0:
        return len(chosen) // 2
    lower = _bins(own, chosen, axis) <= last
    part = np.concatenate((chosen[lower], chosen[~lower]))
    chosen[:] = part
    return int(lower.sum())


@jit
def _cheapest_cut(own: FloatArray, chosen: IntArray) -> tuple[int, int]:
    """Axis and last bin of the first child, of the cheapest cut; axis -1 where none parts."""
    best, axis, last = np.inf, -1, 0
    for c in range(3):
        cost = _costs(own, chosen, _bins(own, chosen, c))
        least = int(np.argmin(cost))
        if cost[least] < best:
            best, axis, last = cost[least], c, least
    return axis, last


@jit
def _bins(own: FloatArray, chosen: IntArray, axis: int) -> IntArray:
    """Number of the bin that the middle of each member lies in; all 0 where they don't differ."""
    out = np.zeros(len(chosen), dtype=np.int64)
    middle = np.empty(len(chosen))
    for k in range(len(chosen)):
        middle[k] = own[chosen[k], axis] + own[chosen[k], 3 + axis]
    low = middle.min()
    span = middle.max() - low
    if span > 0.0:
        for k in range(len(chosen)):
            out[k] = min(int((middle[k] - low) / span * BINS), BINS - 1)
    return out


@jit
def _costs(own: FloatArray, chosen: IntArray, bins: IntArray) -> FloatArray:
    """Cost of a cut above each bin but the last: members of both sides times their faces."""
    count, box = np.zeros(BINS, dtype=np.int64), _empty(BINS)
    for k in range(len(chosen)):
        count[bins[k]] += 1
        _take_in(box[bins[k]], own[chosen[k]])
    out = np.zeros(BINS - 1)
    for way in range(2):
        held, around = 0, _empty(1)[0]
        for k in range(BINS - 1):
            one = BINS - 1 - k if way else k
            held += count[one]
            _take_in(around, box[one])
            out[one - way] += held * _faces(around) if held else np.inf
    return out
