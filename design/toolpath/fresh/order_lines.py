"""Order infill lines by nearest neighbour into zig-zag chains, then improve them by 2-opt."""

from __future__ import annotations

import numpy as np

from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray

#: Improvement rounds of 2-opt; most layers settle in fewer.
ROUNDS = 20


def order_lines(
    start: FloatArray, end: FloatArray, at: FloatArray, link_mm: float
) -> tuple[IntArray, BoolArray]:
    """Order lines so that the travel between them is short.

    Nearest neighbour links lines into chains, to and fro; 2-opt then orders the chains.

    Parameters
    ----------
    start, end : (n, 2) float64, mm
    at : (2,) float64, mm
        Where the needle is.
    link_mm : float, mm
        Lines whose ends are no further apart belong to one chain.

    Returns
    -------
    order : (n,) int64
        Lines in the order of writing.
    flipped : (n,) bool
        Whether a line (by its number, not its place) is written from end to start.
    """
    count = len(start)
    if count == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    ends = np.ascontiguousarray(np.stack([start, end], axis=1))
    at = np.ascontiguousarray(at, dtype=np.float64)
    spread = float(np.ptp(ends.reshape(-1, 2), axis=0).max()) / count**0.5
    order, flipped, gap = _chained(ends, at, max(link_mm, spread, 1e-9))
    first = np.flatnonzero(np.append(True, gap[1:] > link_mm))
    bounds = np.append(first, count)
    last = bounds[1:] - 1
    whole = np.stack(
        [
            ends[order[first], flipped[order[first]].astype(np.int64)],
            ends[order[last], 1 - flipped[order[last]].astype(np.int64)],
        ],
        axis=1,
    )
    chain, turned = np.arange(len(first)), np.zeros(len(first), dtype=np.bool_)
    _two_opt(np.ascontiguousarray(whole), at, chain, turned, ROUNDS)
    parts = []
    for k in chain.tolist():
        part = order[bounds[k] : bounds[k + 1]]
        if turned[k]:
            part = part[::-1]
            flipped[part] = ~flipped[part]
        parts.append(part)
    return np.concatenate(parts), flipped


@jit
def _cell(x: float, y: float, low: FloatArray, side: float, columns: int, rows: int) -> int:
    column = min(max(int((x - low[0]) / side), 0), columns - 1)
    row = min(max(int((y - low[1]) / side), 0), rows - 1)
    return row * columns + column


@jit
def _chained(
    ends: FloatArray, at: FloatArray, side: float
) -> tuple[IntArray, BoolArray, FloatArray]:
    """Nearest neighbour; near ends come from cells, far ones from a list of what is left."""
    count = len(ends)
    low = np.array([ends[:, :, 0].min(), ends[:, :, 1].min()])
    columns = int((ends[:, :, 0].max() - low[0]) / side) + 1
    rows = int((ends[:, :, 1].max() - low[1]) / side) + 1
    head = np.full(columns * rows, -1, np.int64)
    follow = np.empty(2 * count, np.int64)
    for k in range(2 * count - 1, -1, -1):
        cell = _cell(ends[k // 2, k % 2, 0], ends[k // 2, k % 2, 1], low, side, columns, rows)
        follow[k] = head[cell]
        head[cell] = k
    left, place = np.arange(count), np.arange(count)
    order, flipped = np.empty(count, np.int64), np.zeros(count, np.bool_)
    gap, done = np.empty(count), np.zeros(count, np.bool_)
    x, y = at[0], at[1]
    for step in range(count):
        best, nearest = np.inf, -1
        cell = _cell(x, y, low, side, columns, rows)
        row, column = cell // columns, cell % columns
        for near_row in range(max(row - 1, 0), min(row + 2, rows)):
            for near_column in range(max(column - 1, 0), min(column + 2, columns)):
                k = head[near_row * columns + near_column]
                while k >= 0:
                    if not done[k // 2]:
                        d = (ends[k // 2, k % 2, 0] - x) ** 2 + (ends[k // 2, k % 2, 1] - y) ** 2
                        if d < best or (d == best and k < nearest):
                            best, nearest = d, k
                    k = follow[k]
        if best > side * side:
            best, nearest = np.inf, -1
            for j in range(count - step):
                for turn in range(2):
                    k = 2 * left[j] + turn
                    d = (ends[left[j], turn, 0] - x) ** 2 + (ends[left[j], turn, 1] - y) ** 2
                    if d < best or (d == best and k < nearest):
                        best, nearest = d, k
        line = nearest // 2
        done[line] = True
        other = left[count - step - 1]
        left[place[line]] = other
        place[other] = place[line]
        order[step], flipped[line], gap[step] = line, nearest % 2 == 1, np.sqrt(best)
        far = 1 - nearest % 2
        x, y = ends[line, far, 0], ends[line, far, 1]
    return order, flipped, gap


@jit
def _gap(ax: float, ay: float, bx: float, by: float) -> float:
    distance: float = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2)
    return distance


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
