"""Extend a writing stroke through nodes by the straightest unwritten vessel stretches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.stretches import Stretches, is_whole, step_of, vertex
from design.toolpath.embedded.walk import Progress, undo_write, write_stretch
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class Ends(NamedTuple):
    """Vessels' ends at each point, those of point p in ``start[begin[p] : begin[p + 1]]``.

    Attributes
    ----------
    begin : (p + 1,) int64
    start : (2 v,) int64
        Starts that lead away from the point.
    """

    begin: IntArray
    start: IntArray


def ends_of(elements: Elements) -> Ends:
    """Both ends of every vessel by their points."""
    low, high = elements.first[:-1], elements.first[1:] - 1
    start = np.concatenate([2 * low, 2 * high + 1])
    point = np.concatenate([elements.end[low, 0], elements.end[high, 1]])
    order = np.lexsort((start, point))
    count = np.bincount(point, minlength=len(elements.point))
    return Ends(np.concatenate([[0], np.cumsum(count)]), start[order])


@jit
def first_of(start: int, ends: Ends, head: IntArray, elements: Elements, rules: Rules,
             progress: Progress, stretches: Stretches) -> IntArray:  # fmt: skip
    """Starts of stretches to be written before one, from end to end, that lead to it; itself last.

    At each node the straightest is taken that can be written whole.
    """
    starts = [start]
    while True:
        here = starts[-1]
        leads = _leading(here, starts, ends, head, elements, rules, progress, stretches)
        if leads < 0:
            break
        starts.append(leads)
    return np.array(starts[::-1], np.int64)


@jit
def _leading(start: int, taken: list[int], ends: Ends, head: IntArray, elements: Elements,
             rules: Rules, progress: Progress, stretches: Stretches) -> int:  # fmt: skip
    """Start of the straightest whole stretch that ends where one begins; -1 for none."""
    point = vertex(start // 2, step_of(start), True, elements)
    vessel = elements.vessel[start // 2]
    way = direction(start, elements)
    best, most = -1, -np.inf
    for k in range(ends.begin[point], ends.begin[point + 1]):
        away = ends.start[k]
        if away == start or progress.written[away // 2]:
            continue
        if head[elements.vessel[away // 2]] != head[vessel]:
            continue
        far = far_end(away, elements, progress)
        if _has(taken, far, away) or not is_whole(far, elements, rules, progress, stretches):
            continue
        straight = -(way * direction(away, elements)).sum()
        if straight > most:
            best, most = far, straight
    return best


@jit
def _has(taken: list[int], one: int, other: int) -> bool:
    for start in taken:
        if start in (one, other):
            return True
        if start // 2 in (one // 2, other // 2):
            return True
    return False


@jit
def far_end(start: int, elements: Elements, progress: Progress) -> int:
    """Start at the other end of the stretch that one begins."""
    vessel, step, here = elements.vessel[start // 2], step_of(start), start // 2
    low, high = elements.first[vessel], elements.first[vessel + 1]
    while low <= here + step < high and not progress.written[here + step]:
        here += step
    return 2 * here + (1 if step > 0 else 0)


@jit
def direction(start: int, elements: Elements) -> FloatArray:
    """Unit vector along the first element of a stretch, away from where it begins."""
    step = step_of(start)
    tail = elements.point[vertex(start // 2, step, True, elements)]
    way = elements.point[vertex(start // 2, step, False, elements)] - tail
    return way / np.sqrt((way * way).sum())


@jit
def going_on(element: int, step: int, ends: Ends, head: IntArray, elements: Elements,
             rules: Rules, progress: Progress) -> tuple[int, int]:  # fmt: skip
    """Start and size of the straightest stretch from where a pass ends, now written; or -1, 0."""
    point = vertex(element, step, False, elements)
    way = direction(2 * element + (0 if step > 0 else 1), elements)
    vessel = elements.vessel[element]
    tried = [0][:0]
    while True:
        best, most = -1, -np.inf
        for k in range(ends.begin[point], ends.begin[point + 1]):
            start = ends.start[k]
            if progress.written[start // 2] or start in tried:
                continue
            if head[elements.vessel[start // 2]] != head[vessel]:
                continue
            straight = (way * direction(start, elements)).sum()
            if straight > most:
                best, most = start, straight
        if best < 0:
            return -1, 0
        count, stop = write_stretch(best // 2, step_of(best), elements, rules, progress)
        if stop < 0 and count:
            return best, count
        undo_write(best // 2, step_of(best), count, rules, progress)
        tried.append(best)
