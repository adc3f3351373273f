"""Number a needle's unbroken writing strokes; path length from each move to stroke ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Passes:
    """Of each row of one head.

    Attributes
    ----------
    run : (n,) int64
        Pass that the row writes, or the last one before it; -1 for none.
    arc : (n, 2) float64, mm
        Path before the row's two ends since the pass began, and on from its end.
    last, next : (n,) int64
        Last written row at or before, and first at or after; -1 for none.
    since : (n, 2) float64, mm
        Way from the last pass's end to both ends of the row; 0 in a pass, inf before the first.
    until : (n, 2) float64, mm
        From both ends to the next pass's start; 0 in a pass, inf behind the last.
    """

    run: IntArray
    arc: FloatArray
    last: IntArray
    next: IntArray
    since: FloatArray
    until: FloatArray


def passes_of(tips: FloatArray, writes: NDArray[np.bool_]) -> Passes:
    """Find a head's passes: rows that write, with no motion between them that doesn't.

    A rise out of a pass's end and a descent to a start count by what they go in the plan alone: a
    needle that rises stands in the same ink as before.

    Parameters
    ----------
    tips : (n, 2, 3) float64, mm
        Before and after each row.
    writes : (n,) bool
    """
    step = tips[:, 1] - tips[:, 0]
    length = np.linalg.norm(step, axis=1)
    flat = np.hypot(step[:, 0], step[:, 1])
    rows = np.arange(len(tips))
    travels = ~writes & (length > 0)
    last = np.maximum.accumulate(np.where(writes, rows, -1)) if len(rows) else rows
    following = np.where(writes, rows, len(rows))
    following = np.minimum.accumulate(following[::-1])[::-1] if len(rows) else rows
    before = np.concatenate([[0], np.cumsum(travels)[:-1]])[: len(rows)]
    begins = writes.copy()
    previous = np.concatenate([[-1], last[:-1]])[: len(rows)]
    begins &= (previous < 0) | (before > before[np.maximum(previous, 0)])
    run = np.cumsum(begins) - 1
    written = np.concatenate([[0.0], np.cumsum(np.where(writes, length, 0.0))])
    begin = np.flatnonzero(begins)
    base = written[begin][np.maximum(run, 0)] if len(begin) else np.zeros(len(rows))
    away = np.where(writes, 0.0, np.where(step[:, 2] >= 0, flat, length))
    back = np.where(writes, 0.0, np.where(step[:, 2] <= 0, flat, length))
    since = _since(away, last)
    until = _since(back[::-1], np.where(following < len(rows), len(rows) - 1 - following, -1)[::-1])
    arc = np.column_stack([written[:-1] - base, written[1:] - base])
    left = np.where(np.isfinite(since), since, 0.0)
    return Passes(
        run,
        arc + left,
        last,
        np.where(following < len(rows), following, -1),
        since,
        until[::-1, ::-1],
    )


def _since(cost: FloatArray, last: IntArray) -> FloatArray:
    """Cost gathered since the last written row before each row's two ends; inf without one."""
    whole = np.concatenate([[0.0], np.cumsum(cost)])
    base = whole[np.maximum(last, 0) + 1] if len(last) else whole[1:]
    costs = np.column_stack([whole[:-1] - base, whole[1:] - base])
    costs[last < 0] = np.inf
    return np.maximum(costs, 0.0)
