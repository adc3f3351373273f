"""Running sums of path written, ink pushed and purged along a print; find where a fault begins.

A place in a print is a number: whole part the block, rest the share of that block which is done.
It ascends whatever the printer's clock does (a reset sets that to 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from sim.gcode.deposit.ink_faults import LEAST_PURGE_UL, PURGE_RATIO, RELOAD_UL, Moment


@dataclass(frozen=True)
class Timeline:
    """Running sums at the blocks' ends.

    Attributes
    ----------
    time_s : (n, 2) float64, s
        Begin and end of each block.
    line : (n,) int64
        Command of the job, from 0; -1 for none of it.
    written_mm, pushed_ul, purged_ul : (n + 1,) float64
        Before each block, and after the last.
    """

    time_s: FloatArray
    line: IntArray
    written_mm: FloatArray
    pushed_ul: FloatArray
    purged_ul: FloatArray

    @staticmethod
    def of(
        time_s: FloatArray,
        line: IntArray,
        way_mm: FloatArray,
        push_ul: FloatArray,
        writes: BoolArray,
    ) -> Timeline:
        """Sum up blocks: their way, what the plunger pushes (below 0: goes back), which write."""
        new = _pushed_anew(push_ul)
        dense = np.divide(new, way_mm, out=np.full(len(new), np.inf), where=way_mm > 0)
        usual = np.median(dense[writes & (new > 0)]) if (writes & (new > 0)).any() else np.inf
        purge = np.where((new >= LEAST_PURGE_UL) & (dense >= PURGE_RATIO * usual), new, 0.0)
        return Timeline(
            time_s,
            line,
            np.concatenate([[0.0], np.cumsum(np.where(writes, way_mm, 0.0))]),
            np.concatenate([[0.0], np.cumsum(new)]),
            np.concatenate([[0.0], np.cumsum(purge)]),
        )

    def begins(self, moment: Moment) -> float:
        """Place at which a fault begins; inf when the print hasn't come so far."""
        if moment.line is not None:
            return self._first(self.line >= moment.line - 1)
        if moment.written_mm is not None:
            return when(self.written_mm, moment.written_mm)
        if moment.pushed_ul is not None:
            return when(self.pushed_ul, moment.pushed_ul)
        return float(self.at_times(np.array([moment.time_s or 0.0]))[0])

    def seconds(self, place: FloatArray) -> FloatArray:
        """Printer's clock at places, s."""
        block = np.clip(np.asarray(place).astype(np.int64), 0, max(len(self.line) - 1, 0))
        begin, end = self.time_s[block].T
        return np.asarray(begin + (place - block) * (end - begin))

    def at_times(self, seconds: FloatArray) -> FloatArray:
        """Places at times of the printer's clock, (n,); inf where the print hasn't come so far."""
        ends = np.maximum.accumulate(self.time_s[:, 1])
        index = np.searchsorted(ends, seconds, side="left")
        block = np.minimum(index, len(ends) - 1)
        begin, end = self.time_s[block].T
        lasts = np.where(end > begin, end - begin, 1.0)
        share = np.clip((seconds - begin) / lasts, 0.0, 1.0)
        return np.where(index < len(ends), block + share, np.inf)

    @staticmethod
    def _first(holds: BoolArray) -> float:
        return float(holds.argmax()) if holds.any() else math.inf


def _pushed_anew(push_ul: FloatArray) -> FloatArray:
    """What each block pushes beyond the plunger's foremost place, (n,), µL.

    A plunger that goes back by more than `RELOAD_UL` comes to a full syringe.
    """
    total = np.concatenate([[0.0], np.cumsum(push_ul)])
    new, begin = np.zeros(len(push_ul)), 0
    while begin < len(push_ul):
        foremost = np.maximum.accumulate(total[begin:])
        back = np.flatnonzero(foremost - total[begin:] > RELOAD_UL)
        if not len(back):
            new[begin:] = np.diff(foremost)
            break
        turn = begin + int(back[0])
        new[begin:turn] = np.diff(foremost[: turn - begin + 1])
        forward = np.flatnonzero(push_ul[turn:] > 0)
        begin = turn + int(forward[0]) if len(forward) else len(push_ul)
    return new


def at(total: FloatArray, place: FloatArray | float) -> FloatArray:
    """A running sum at places."""
    return np.asarray(np.interp(place, np.arange(len(total)), total))


def when(total: FloatArray, value: float) -> float:
    """First place at which a running sum reaches a value; inf when it doesn't."""
    block = int(np.searchsorted(total[1:], value, side="left"))
    if block == len(total) - 1:
        return math.inf
    low, high = float(total[block]), float(total[block + 1])
    return block + (max(0.0, (value - low) / (high - low)) if high > low else 0.0)
