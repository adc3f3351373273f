"""One layer's paths as flat arrays, and their order of writing for short travels."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray


class Role(IntEnum):
    """What a path is for, in the order of writing."""

    WALL = 0
    """Along a boundary; walls nearer to it come first."""
    GAP = 1
    """In a place too thin for a wall."""
    INFILL = 2
    """Inside the walls."""


class Paths(NamedTuple):
    """Paths, each a run of points; kernels take it as it is."""

    points: FloatArray  # (n, 2), mm
    # (n,), mm, of the line that comes to each point; of a closed path's first point, of the line
    # from its last
    width_mm: FloatArray
    offset: IntArray  # (m + 1,), path k is ``points[offset[k] : offset[k + 1]]``
    closed: BoolArray  # (m,), closed paths don't repeat their first point and may begin anywhere
    role: IntArray  # (m,), a `Role` each
    level: IntArray  # (m,), the wall's number counted from the boundary

    @property
    def number(self) -> int:
        """How many paths there are."""
        return len(self.closed)


def gather(
    lines: Sequence[FloatArray],
    widths: Sequence[FloatArray],
    *,
    closed: bool,
    role: Role,
    level: int = 0,
) -> Paths:
    """Paths of one role from arrays of points (k, 2) and widths (k,)."""
    count = len(lines)
    return Paths(
        np.concatenate([np.zeros((0, 2)), *lines]),
        np.concatenate([np.zeros(0), *widths]),
        np.cumsum([0, *map(len, lines)], dtype=np.int64),
        np.full(count, closed),
        np.full(count, int(role), dtype=np.int64),
        np.full(count, level, dtype=np.int64),
    )


def join(parts: Sequence[Paths]) -> Paths:
    """All paths, in the order given."""
    parts = [gather([], [], closed=False, role=Role.WALL), *parts]
    shift = np.cumsum([0, *(len(part.points) for part in parts)])
    offsets = [part.offset[1:] + low for part, low in zip(parts, shift[:-1], strict=True)]
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Paths(*columns)._replace(offset=np.concatenate([np.zeros(1, dtype=np.int64), *offsets]))


SMALL_RING_MM: Final = 3.0
"""Beginning a larger ring elsewhere than near by costs more way than it is worth."""


class WritingOrder(NamedTuple):
    """Paths in the order of writing."""

    path: IntArray  # (m,), numbers of the paths
    first: IntArray  # (m,), point, in `Paths.points`, at which each begins
    backward: BoolArray  # (m,), whether it is written from its end to its begin

    def then(self, other: WritingOrder) -> WritingOrder:
        """Both, one after the other."""
        return WritingOrder(*(np.concatenate(both) for both in zip(self, other, strict=True)))


def order_paths(
    paths: Paths, at: FloatArray, link_mm: float, seam_rad: float = 0.0
) -> WritingOrder:
    """Walls and gaps first, each lumen's from the inside out; then the infill.

    Parameters
    ----------
    paths : Paths
    at : (2,) float64, mm
        Where the needle is.
    link_mm : float, mm
        Infill lines no further apart than this are written in one go.
    seam_rad : float, rad
        Where on small rings along the boundary, seen from their middle, writing begins. The begin
        of a line is its weakest place; it should differ from layer to layer.
    """
    outline = np.flatnonzero(paths.role != Role.INFILL)
    lines = np.flatnonzero(paths.role == Role.INFILL)
    done = _outlines(paths, outline, at, seam_rad)
    if len(outline):
        last, backward = done.path[-1], done.backward[-1]
        ends = paths.offset[last] if backward else paths.offset[last + 1] - 1
        at = paths.points[done.first[-1] if paths.closed[last] else ends]
    start = paths.points[paths.offset[lines]]
    end = paths.points[paths.offset[lines + 1] - 1]
    order, flipped = order_lines(start, end, at, link_mm)
    path, turned = lines[order], flipped[order]
    first = np.where(turned, paths.offset[path + 1] - 1, paths.offset[path])
    return done.then(WritingOrder(path, first, turned))


def _outlines(paths: Paths, which: IntArray, at: FloatArray, seam_rad: float) -> WritingOrder:
    """Nearest neighbour, a wall not before the wall between it and the boundary."""
    low = np.minimum.reduceat(paths.points, paths.offset[:-1])
    high = np.maximum.reduceat(paths.points, paths.offset[:-1])
    towards = np.array([np.cos(seam_rad), np.sin(seam_rad)])
    before = _outer(paths, which, low, high)
    return WritingOrder(*_nearest_outlines(paths, which, before, low, high, at, towards))


def _outer(paths: Paths, which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
    """The wall that must be written before each path; -1 for none."""
    before = np.full(paths.number, -1, dtype=np.int64)
    walls = which[paths.role[which] == Role.WALL]
    for level in range(1, int(paths.level[walls].max(initial=0)) + 1):
        outer = walls[paths.level[walls] == level - 1]
        inner = walls[paths.level[walls] == level]
        if len(outer) and len(inner):
            starts = paths.points[paths.offset[inner]]
            before[inner] = _nearest_paths(starts, outer, paths, low, high)
    return before


@jit
def _box_gap(x: float, y: float, low: FloatArray, high: FloatArray) -> float:
    dx, dy = max(low[0] - x, 0.0, x - high[0]), max(low[1] - y, 0.0, y - high[1])
    return dx * dx + dy * dy


@jit
def _nearest_paths(
    at: FloatArray, which: IntArray, paths: Paths, low: FloatArray, high: FloatArray
) -> IntArray:
    """Path of ``which`` that has the point nearest to each of ``at``."""
    points, offset = paths.points, paths.offset
    nearest = np.empty(len(at), np.int64)
    for j in range(len(at)):
        x, y, best = at[j, 0], at[j, 1], np.inf
        for k in which:
            if _box_gap(x, y, low[k], high[k]) >= best:
                continue
            for i in range(offset[k], offset[k + 1]):
                gap = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                if gap < best:
                    best, nearest[j] = gap, k
    return nearest


@jit
def _nearest_outlines(
    paths: Paths, which: IntArray, before: IntArray, low: FloatArray, high: FloatArray,
    at: FloatArray, towards: FloatArray,
) -> tuple[IntArray, IntArray, BoolArray]:  # fmt: skip
    """Path, first point and direction of each of ``which``, none before the one in ``before``."""
    points, offset, closed = paths.points, paths.offset, paths.closed
    count = len(which)
    left = which.copy()
    done = np.zeros(len(closed), np.bool_)
    path, first = np.empty(count, np.int64), np.empty(count, np.int64)
    backward = np.zeros(count, np.bool_)
    x, y = at[0], at[1]
    for step in range(count):
        best, place, begin = np.inf, -1, 0
        for j in range(count - step):
            k = left[j]
            if before[k] >= 0 and not done[before[k]]:
                continue
            if _box_gap(x, y, low[k], high[k]) >= best:
                continue
            last = offset[k + 1] - 1
            stride = 1 if closed[k] else max(last - offset[k], 1)
            for i in range(offset[k], last + 1, stride):
                gap = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                if gap < best:
                    best, place, begin = gap, j, i
        k = left[place]
        left[place] = left[count - step - 1]
        done[k] = True
        if closed[k] and before[k] < 0 and max(high[k] - low[k]) <= SMALL_RING_MM:
            most = -np.inf
            for i in range(offset[k], offset[k + 1]):
                far = points[i, 0] * towards[0] + points[i, 1] * towards[1]
                if far > most:
                    most, begin = far, i
        path[step], first[step] = k, begin
        at_end = not closed[k] and begin == offset[k + 1] - 1 and begin > offset[k]
        backward[step] = at_end
        stop = begin if closed[k] else (offset[k] if at_end else offset[k + 1] - 1)
        x, y = points[stop, 0], points[stop, 1]
    return path, first, backward


MAX_ROUNDS: Final = 20
"""Improvement rounds of 2-opt; most layers settle in fewer."""


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
    _two_opt(np.ascontiguousarray(whole), at, chain, turned)
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
def _gap(a: FloatArray, b: FloatArray) -> float:
    distance: float = np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)
    return distance


@jit
def _end(line: int, last: bool, ends: FloatArray, flipped: BoolArray) -> FloatArray:
    """Where a line begins, or ends, as it is written."""
    return ends[line, 1 if last != flipped[line] else 0]


@jit
def _two_opt(ends: FloatArray, at: FloatArray, order: IntArray, flipped: BoolArray) -> None:
    """Reverse stretches of the order, each line in them turned, while that saves travel."""
    count = len(order)
    for _ in range(MAX_ROUNDS):
        saved = False
        for i in range(count):
            a = at if i == 0 else _end(order[i - 1], True, ends, flipped)
            b = _end(order[i], False, ends, flipped)
            entered = _gap(a, b)
            for j in range(i, count):
                c = _end(order[j], True, ends, flipped)
                change = _gap(a, c) - entered
                if j + 1 < count:
                    if change >= entered and change > 0:
                        continue
                    d = _end(order[j + 1], False, ends, flipped)
                    change += _gap(b, d) - _gap(c, d)
                if change < -1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1].copy()
                    for k in range(i, j + 1):
                        flipped[order[k]] = not flipped[order[k]]
                    saved = True
                    b = _end(order[i], False, ends, flipped)
                    entered = _gap(a, b)
        if not saved:
            break
