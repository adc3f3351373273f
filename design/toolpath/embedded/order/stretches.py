"""Extend a writing stroke through nodes by the straightest unwritten vessel stretches.

Track unwritten stretches of vessels, and test if each can be written in one stroke.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class Ends(NamedTuple):
    """Vessels' ends at each point, those of point p in ``start[begin[p] : begin[p + 1]]``."""

    begin: IntArray  # (p + 1,)
    start: IntArray  # (2 v,), starts that lead away from the point


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


class Progress(NamedTuple):
    """What is written, and for how many unwritten elements each still waits."""

    written: NDArray[np.bool_]  # (n,)
    waiting: IntArray  # (n,), at most 0 where an element may be written


def start_walk(rules: Rules, out: NDArray[np.bool_] | None = None) -> Progress:
    """Nothing written yet; elements that are ``out`` (n,) count as written, and have no rules."""
    count = len(rules.begin) - 1
    waiting = np.bincount(rules.after, minlength=count)
    written = np.zeros(count, dtype=np.bool_) if out is None else out.copy()
    return Progress(written, waiting)


@jit
def write_stretch(
    element: int, step: int, elements: Elements, rules: Rules, progress: Progress
) -> tuple[int, int]:
    """Write from an element on until the vessel ends, or ink, or what must wait.

    Returns how many, and the element that must wait; -1 where none stands in the way. What is
    written is marked in `progress`; `undo_write` takes it back.
    """
    vessel = elements.vessel[element]
    low, high = elements.first[vessel], elements.first[vessel + 1]
    count, here = 0, element
    while low <= here < high and not progress.written[here]:
        if progress.waiting[here] > 0:
            return count, here
        progress.written[here] = True
        for k in range(rules.begin[here], rules.begin[here + 1]):
            progress.waiting[rules.after[k]] -= 1
        count += 1
        here += step
    return count, -1


@jit
def undo_write(element: int, step: int, count: int, rules: Rules, progress: Progress) -> None:
    """Take back what `write_stretch` wrote."""
    for n in range(count):
        here = element + step * n
        progress.written[here] = False
        for k in range(rules.begin[here], rules.begin[here + 1]):
            progress.waiting[rules.after[k]] += 1


WHOLE, UNKNOWN = -1, -2
"""Values of `Stretches.stop`."""


class Stretches(NamedTuple):
    """Where stretches may be begun: start ``2 e`` goes on from element e, ``2 e + 1`` backward."""

    live: IntArray  # (2 n,), starts of unwritten stretches, ``size[0]`` of them in no order
    place: IntArray  # (2 n,), of each start in `live`; -1 for those that aren't there
    size: IntArray  # (1,)
    stop: IntArray  # (2 n,), element at which a stretch would wait, or `WHOLE`, `UNKNOWN`
    until: IntArray  # (2 n,), count at the stop's `waiting` of which another look is worth it


def none_open(count: int) -> Stretches:
    """No stretch of so many elements."""
    empty = np.full(2 * count, -1, dtype=np.int64)
    return Stretches(empty, empty.copy(), np.zeros(1, np.int64), empty.copy(), empty.copy())


@jit
def step_of(start: int) -> int:
    """1 where a start leads on along its vessel, -1 where against it."""
    return 1 if start % 2 == 0 else -1


@jit
def vertex(element: int, step: int, outer: bool, elements: Elements) -> int:
    """Point where an element begins (outer) or ends, gone through by `step`."""
    return elements.end[element, 0 if (step > 0) == outer else 1]


@jit
def open_stretch(low: int, high: int, stretches: Stretches) -> None:
    """Let elements ``low`` to ``high - 1`` be begun from either end."""
    for start in (2 * low, 2 * (high - 1) + 1):
        stretches.stop[start] = UNKNOWN
        if stretches.place[start] < 0:
            stretches.place[start] = stretches.size[0]
            stretches.live[stretches.size[0]] = start
            stretches.size[0] += 1


@jit
def close_start(start: int, stretches: Stretches) -> None:
    """Take a start out of those that are live."""
    at = stretches.place[start]
    if at < 0:
        return
    stretches.size[0] -= 1
    last = stretches.live[stretches.size[0]]
    stretches.live[at], stretches.place[last] = last, at
    stretches.place[start] = -1


@jit
def close_written(first: int, last: int, progress: Progress, elements: Elements,
                  stretches: Stretches) -> None:  # fmt: skip
    """Elements ``first`` to ``last`` have been written: open what is left on either side."""
    vessel = elements.vessel[first]
    low, high = first, last + 1
    while low > elements.first[vessel] and not progress.written[low - 1]:
        low -= 1
    while high < elements.first[vessel + 1] and not progress.written[high]:
        high += 1
    close_start(2 * low, stretches)
    close_start(2 * (high - 1) + 1, stretches)
    if low < first:
        open_stretch(low, first, stretches)
    if last + 1 < high:
        open_stretch(last + 1, high, stretches)


@jit
def is_whole(start: int, elements: Elements, rules: Rules, progress: Progress,
             stretches: Stretches) -> bool:  # fmt: skip
    """Whether a stretch can be written to its end; looked at again when it may have changed."""
    stop = stretches.stop[start]
    if stop == WHOLE:
        return True
    if stop >= 0 and progress.waiting[stop] > stretches.until[start]:
        return False
    count, stop = write_stretch(start // 2, step_of(start), elements, rules, progress)
    inside = progress.waiting[stop] if stop >= 0 else 0
    undo_write(start // 2, step_of(start), count, rules, progress)
    stretches.stop[start] = stop
    if stop >= 0:
        # What the stretch itself would have set free before it came there doesn't count.
        stretches.until[start] = progress.waiting[stop] - inside
    return stop == WHOLE
