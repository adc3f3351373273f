"""Split executed motion into intervals of constant tip and plunger speed, pauses included."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.gcode.motion.executed import ExecutedMotion

GAP_S: Final = 1e-6
"""Less between two blocks is rounding."""
PER_LAG: Final = 8
"""Pieces in a time constant: the flow within one is told by its mean."""
STANDING: Final = 40
"""Most pieces of a block or pause; five time constants are over by then."""


@dataclass(frozen=True)
class Pieces:
    """Stretches of time in each of which tip and plunger go at a constant speed.

    The speed within one block is taken as its mean: what a block speeds up and slows down takes
    v/a, hundredths of a second.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip.
    time : (n + 1,) float64, s
        Where each begins, and the end.
    push_ul : (n,) float64, µL
        What the plunger pushes, evenly, below 0 where it goes back.
    jump_ul : (n,) float64, µL
        What it pushes at once as the piece begins (an advance).
    block : (n,) int64
        Of the executed motion; -1 where all stands between two blocks.
    """

    start: FloatArray
    end: FloatArray
    time: FloatArray
    push_ul: FloatArray
    jump_ul: FloatArray
    block: IntArray

    def __len__(self) -> int:
        return len(self.block)

    @property
    def duration(self) -> FloatArray:
        """Of each, (n,), s."""
        return np.diff(self.time)

    @property
    def length(self) -> FloatArray:
        """Way of the tip, (n,), mm."""
        return np.linalg.norm(self.end - self.start, axis=1)


def cut(
    executed: ExecutedMotion,
    area_mm2: float,
    advance_mm: FloatArray | None = None,
    *,
    lag_s: float = 0.0,
    longest_mm: float = 0.25,
    until_s: float = 0.0,
) -> Pieces:
    """Cut a motion, so that no piece is long against the lag or the way.

    Parameters
    ----------
    executed : ExecutedMotion
        Of one head.
    area_mm2 : float, mm²
        Of the plunger, times what comes out over what is pushed.
    advance_mm : (n,) float64, mm, optional
        How far the firmware's advance holds the plunger ahead in each block; nothing without.
        It is put in as the block begins.
    lag_s : float, s
    longest_mm : float, mm
        Longest piece of way.
    until_s : float, s
        How long all stands after the last block.
    """
    rows = _with_gaps(executed, until_s)
    block, time, start, end = rows
    moved = block >= 0
    travel = executed.plunger_end - executed.plunger_start
    push = np.where(moved, travel[block], 0.0) * area_mm2
    ahead = np.zeros(len(block))
    if advance_mm is not None:
        ahead = np.where(moved, advance_mm[block], 0.0) * area_mm2
    jump = np.diff(ahead, prepend=0.0)
    length = np.linalg.norm(end - start, axis=1)
    parts = np.ceil(length / longest_mm - 1e-9)
    if lag_s > 0:
        by_time = np.ceil(np.diff(time) * PER_LAG / lag_s - 1e-9)
        parts = np.maximum(parts, np.minimum(by_time, STANDING))
    return _divided(start, end, time, push, jump, block, np.maximum(parts, 1).astype(np.int64))


def _with_gaps(
    executed: ExecutedMotion, until_s: float
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Blocks and the pauses between them: numbers (-1 a pause), times (n + 1,), places."""
    count = len(executed)
    begins = np.append(executed.time_start, executed.time_end[-1:] + until_s)
    gap = np.flatnonzero(begins[1:] - executed.time_end > GAP_S) + 1
    block = np.insert(np.arange(count, dtype=np.int64), gap, -1)
    after = np.append(executed.start, executed.end[-1:], axis=0)[gap]
    start = np.insert(executed.start, gap, executed.end[gap - 1], axis=0)
    end = np.insert(executed.end, gap, after, axis=0)
    first = np.insert(executed.time_start, gap, executed.time_end[gap - 1])
    last = begins[-1] if count in gap else executed.time_end[-1]
    return block, np.maximum.accumulate(np.append(first, last)), start, end


def _divided(
    start: FloatArray,
    end: FloatArray,
    time: FloatArray,
    push: FloatArray,
    jump: FloatArray,
    block: IntArray,
    parts: IntArray,
) -> Pieces:
    of = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = 1.0 / parts[of]
    way, lasts = (end - start)[of], np.diff(time)[of]
    return Pieces(
        start[of] + (number * share)[:, None] * way,
        start[of] + ((number + 1) * share)[:, None] * way,
        np.append(time[of] + number * share * lasts, time[-1]),
        push[of] * share,
        np.where(number == 0, jump[of], 0.0),
        block[of],
    )


def median_flow(pieces: Pieces) -> float:
    """Flow at which half of what is pushed on the way is pushed, µL/s; 0 where nothing is."""
    writes = (pieces.push_ul > 0) & (pieces.length > 0) & (pieces.duration > 0)
    if not writes.any():
        return 0.0
    flow = pieces.push_ul[writes] / pieces.duration[writes]
    order = np.argsort(flow)
    pushed = np.cumsum(pieces.push_ul[writes][order])
    median = float(flow[order][np.searchsorted(pushed, pushed[-1] / 2)])
    return median if math.isfinite(median) else 0.0
