"""Short orders: nearest neighbour, then 2-opt, for lines that may be written either way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit

BoolArray = NDArray[np.bool_]

#: Improvement rounds of 2-opt; most layers settle in fewer.
ROUNDS = 20


@jit
def _gap(ax: float, ay: float, bx: float, by: float) -> float:
    distance: float = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2)
    return distance


@jit
def _nearest_neighbour(ends: FloatArray, at: FloatArray) -> tuple[IntArray, BoolArray]:
    """Order (n,) and whether each line is written from its end to its start."""
    count = len(ends)
    order, flipped = np.empty(count, np.int64), np.zeros(count, np.bool_)
    left = np.arange(count)
    x, y = at[0], at[1]
    for k in range(count):
        best, place, turn = np.inf, 0, False
        for j in range(count - k):
            line = left[j]
            for side in range(2):
                gap = (ends[line, side, 0] - x) ** 2 + (ends[line, side, 1] - y) ** 2
                # The lower number wins a tie, so that the order of `left` doesn't matter.
                if gap < best or (gap == best and line < left[place]):
                    best, place, turn = gap, j, side == 1
        line = left[place]
        left[place] = left[count - k - 1]
        order[k], flipped[line] = line, turn
        far = 0 if turn else 1
        x, y = ends[line, far, 0], ends[line, far, 1]
    return order, flipped


@jit
def _two_opt(
    ends: FloatArray, at: FloatArray, order: IntArray, flipped: BoolArray, rounds: int
) -> None:
    """Reverse stretches of the order, each line in them turned, while that saves travel."""
    count = len(order)
    for _ in range(rounds):
        saved = False
        for i in range(count):
            if i == 0:
                ax, ay = at[0], at[1]
            else:
                before = order[i - 1]
                side = 0 if flipped[before] else 1
                ax, ay = ends[before, side, 0], ends[before, side, 1]
            entry = 1 if flipped[order[i]] else 0
            bx, by = ends[order[i], entry, 0], ends[order[i], entry, 1]
            entered = _gap(ax, ay, bx, by)
            for j in range(i, count):
                exit_ = 0 if flipped[order[j]] else 1
                cx, cy = ends[order[j], exit_, 0], ends[order[j], exit_, 1]
                change = _gap(ax, ay, cx, cy) - entered
                if j + 1 < count:
                    if change >= entered and change > 0:
                        continue
                    after = order[j + 1]
                    entry = 1 if flipped[after] else 0
                    dx, dy = ends[after, entry, 0], ends[after, entry, 1]
                    change += _gap(bx, by, dx, dy) - _gap(cx, cy, dx, dy)
                if change < -1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1].copy()
                    for k in range(i, j + 1):
                        flipped[order[k]] = not flipped[order[k]]
                    saved = True
                    entry = 1 if flipped[order[i]] else 0
                    bx, by = ends[order[i], entry, 0], ends[order[i], entry, 1]
                    entered = _gap(ax, ay, bx, by)
        if not saved:
            break


def order_lines(start: FloatArray, end: FloatArray, at: FloatArray) -> tuple[IntArray, BoolArray]:
    """Order lines so that the travel between them is short.

    Parameters
    ----------
    start, end : (n, 2) float64, mm
    at : (2,) float64, mm
        Where the needle is.

    Returns
    -------
    order : (n,) int64
        Lines in the order of writing.
    flipped : (n,) bool
        Whether a line (by its number, not its place) is written from end to start.
    """
    ends = np.ascontiguousarray(np.stack([start, end], axis=1))
    at = np.ascontiguousarray(at, dtype=np.float64)
    order, flipped = _nearest_neighbour(ends, at)
    _two_opt(ends, at, order, flipped, ROUNDS)
    return order, flipped


def order_loops(loops: list[FloatArray], at: FloatArray) -> list[FloatArray]:
    """Closed rings by nearest neighbour, each turned to begin at its point nearest the needle.

    Returned rings (k + 1, 2) repeat their first point.
    """
    left, ordered = list(loops), []
    while left:
        gaps = [((ring - at) ** 2).sum(axis=1) for ring in left]
        nearest = min(range(len(left)), key=lambda k: gaps[k].min())
        ring = np.roll(left.pop(nearest), -int(gaps[nearest].argmin()), axis=0)
        ordered.append(np.vstack([ring, ring[:1]]))
        at = ring[0]
    return ordered
