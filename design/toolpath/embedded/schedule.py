"""Order vessel elements into few writing strokes, short travels, no ink in the shaft's way.

What is written never bars anything else, it only sets free; so a stretch that can be written from
end to end may be written at once, and one that can't had better wait. Where all wait for each
other one must be cut: the one whose part sets most others free.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from kernels import jit
from kernels.arrays import FloatArray, IntArray

# Mark a row of vessel elements as written, up to one that must wait or is already written.


class Leg(NamedTuple):
    """Elements of one vessel written in a row: ``element``, then ``size - 1`` more by ``step``."""

    element: int
    step: int
    size: int

    @property
    def last(self) -> int:
        """The element it ends with."""
        return self.element + self.step * (self.size - 1)

    @property
    def middle(self) -> int:
        """Its first and last element's sum: the same whichever way it is written."""
        return self.element + self.last

    def elements(self) -> IntArray:
        """Numbers of all, in order."""
        return self.element + self.step * np.arange(self.size)


@dataclass(frozen=True)
class Pass:
    """Stretches written without lifting the needle."""

    legs: tuple[Leg, ...]

    def elements(self) -> IntArray:
        """Numbers of all, in order."""
        return np.concatenate([leg.elements() for leg in self.legs])


def schedule_passes(
    elements: Elements,
    rules: Rules,
    head: IntArray,
    out: NDArray[np.bool_] | None = None,
) -> list[Pass]:
    """Order all elements into passes, one after another.

    Parameters
    ----------
    elements : Elements
    rules : Rules
    head : (v,) int64
        The head that writes each vessel.
    out : (n,) bool or None
        Elements of vessels that aren't written; no rule names them.
    """
    progress, stretches = start_walk(rules, out), none_open(len(elements.end))
    legs = _legs(elements, rules, head, ends_of(elements), progress, stretches)
    parts = np.split(legs[:, 1:], np.flatnonzero(legs[:, 0])[1:])
    return [Pass(tuple(Leg(*leg) for leg in part.tolist())) for part in parts]


@jit
def _legs(elements: Elements, rules: Rules, head: IntArray, ends: Ends, progress: Progress,
          stretches: Stretches) -> IntArray:  # fmt: skip
    """Legs in their order, (k, 4): 1 where a pass begins, and those of `Leg`."""
    legs = [(0, 0, 0, 0)][:0]
    for vessel in range(len(elements.first) - 1):
        if not progress.written[elements.first[vessel]]:
            open_stretch(elements.first[vessel], elements.first[vessel + 1], stretches)
    tip = elements.point[np.argmin(elements.point[:, 2])].copy()
    tool = head.min()
    while stretches.size[0] > 0:
        start = _nearest_whole(tip, tool, head, elements, rules, progress, stretches)
        if start < 0:
            start = best_cut(tip, tool, head, elements, rules, progress, stretches)
        if start < 0:
            start = _forced(rules, progress)
        begin = len(legs)
        _extend(start, legs, ends, head, elements, rules, progress, stretches)
        for k in range(begin, len(legs)):
            _, element, step, size = legs[k]
            far = element + step * (size - 1)
            close_written(min(element, far), max(element, far), progress, elements, stretches)
        _, element, step, size = legs[-1]
        tip[:] = elements.point[vertex(element + step * (size - 1), step, False, elements)]
        tool = head[elements.vessel[element]]
    out = np.empty((len(legs), 4), np.int64)
    for k in range(len(legs)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = legs[k]
    return out


@jit
def _nearest_whole(tip: FloatArray, tool: int, head: IntArray, elements: Elements, rules: Rules,
                   progress: Progress, stretches: Stretches) -> int:  # fmt: skip
    """Start of the nearest stretch that can be written whole, this head's first; -1 for none."""
    best, least = -1, np.inf
    for k in range(stretches.size[0]):
        start = stretches.live[k]
        if not is_whole(start, elements, rules, progress, stretches):
            continue
        point = elements.point[vertex(start // 2, step_of(start), True, elements)]
        x, y, z = point[0] - tip[0], point[1] - tip[1], point[2] - tip[2]
        away = x * x + y * y + z * z
        if head[elements.vessel[start // 2]] != tool:
            away += 1e12
        if away < least or (away == least and start < best):
            best, least = start, away
    return best


@jit
def _extend(start: int, legs: list[tuple[int, int, int, int]], ends: Ends, head: IntArray,
            elements: Elements, rules: Rules, progress: Progress,
            stretches: Stretches) -> None:  # fmt: skip
    """Add a pass: what leads to a stretch, the stretch, and what goes on from where it ends."""
    stop, first = -1, 1
    for one in first_of(start, ends, head, elements, rules, progress, stretches):
        size, stop = write_stretch(one // 2, step_of(one), elements, rules, progress)
        legs.append((first, one // 2, step_of(one), size))
        first = 0
    while stop < 0:
        _, element, step, size = legs[-1]
        one, size = going_on(
            element + step * (size - 1), step, ends, head, elements, rules, progress
        )
        if one < 0:
            break
        legs.append((0, one // 2, step_of(one), size))


@jit
def _forced(rules: Rules, progress: Progress) -> int:
    """The element that does the least harm written out of turn, where none may be written."""
    harm = np.zeros(len(progress.written))
    for e in range(len(harm)):
        if not progress.written[e]:
            for k in range(rules.begin[e], rules.begin[e + 1]):
                harm[rules.after[k]] += rules.harm[k]
    best = -1
    for e in range(len(harm)):
        if not progress.written[e] and (best < 0 or harm[e] < harm[best]):
            best = e
    progress.waiting[best] = -(1 << 40)
    return 2 * best


# Choose a part of a vessel to write next if no unwritten vessel may be written whole.

TRIED, FOLLOWED = 64, 64
"""Cuts tried where all wait for each other, the lowest; and stretches looked at behind each, as
what a cut sets free sets others free."""


@jit
def best_cut(tip: FloatArray, tool: int, head: IntArray, elements: Elements, rules: Rules,
             progress: Progress, stretches: Stretches) -> int:  # fmt: skip
    """Start of the part that sets most stretches free; -1 where no element may be written."""
    parts = _lowest(_parts(elements, progress), elements)
    watched, follows = _watched(stretches, len(elements.end))
    best, most, size, near = -1, -(1 << 40), 0, np.inf
    for part in parts:
        gain, count = _gain(part, watched, follows, elements, rules, progress, stretches)
        way = elements.point[vertex(part // 2, step_of(part), True, elements)] - tip
        away = (way * way).sum()
        if head[elements.vessel[part // 2]] != tool:
            away += 1e12
        if (
            gain > most
            or (gain == most and count > size)
            or (gain == most and count == size and away < near)
        ):
            best, most, size, near = part, gain, count, away
    return best


@jit
def _parts(elements: Elements, progress: Progress) -> IntArray:
    """Starts at both ends of runs of elements that may be written."""
    starts = [0][:0]
    inside = False
    for e in range(len(elements.end)):
        free = not progress.written[e] and progress.waiting[e] <= 0
        if inside and (not free or elements.vessel[e] != elements.vessel[e - 1]):
            starts.append(2 * (e - 1) + 1)
            inside = False
        if free and not inside:
            starts.append(2 * e)
            inside = True
    if inside:
        starts.append(2 * (len(elements.end) - 1) + 1)
    return np.array(starts, np.int64)


@jit
def _lowest(parts: IntArray, elements: Elements) -> IntArray:
    if len(parts) <= TRIED:
        return parts
    height = np.empty(len(parts))
    for k in range(len(parts)):
        height[k] = elements.point[vertex(parts[k] // 2, step_of(parts[k]), True, elements)][2]
    return parts[np.argsort(height, kind="mergesort")[:TRIED]]


@jit
def _watched(stretches: Stretches, count: int) -> tuple[IntArray, IntArray]:
    """First start that waits at each element, and of each start the next one; -1 for none."""
    first, following = np.full(count, -1), np.full(2 * count, -1)
    for k in range(stretches.size[0]):
        start = stretches.live[k]
        stop = stretches.stop[start]
        if stop >= 0:
            following[start], first[stop] = first[stop], start
    return first, following


@jit
def _gain(part: int, watched: IntArray, follows: IntArray, elements: Elements, rules: Rules,
          progress: Progress, stretches: Stretches) -> tuple[int, int]:  # fmt: skip
    """Stretches that a part sets free in turn, less twice what it leaves; and its size."""
    size, stop = write_stretch(part // 2, step_of(part), elements, rules, progress)
    done = [(part, size)]
    queue = [0][:0]
    at, freed = 0, 0
    while at < len(done):
        _freed_by(done[at], watched, follows, queue, rules, progress, stretches)
        at += 1
        while len(queue) and freed < FOLLOWED:
            start = queue.pop()
            if progress.written[start // 2]:
                continue
            count, end = write_stretch(start // 2, step_of(start), elements, rules, progress)
            if end < 0:
                freed += 1
                done.append((start, count))
            else:
                undo_write(start // 2, step_of(start), count, rules, progress)
    for k in range(len(done) - 1, -1, -1):
        start, count = done[k]
        undo_write(start // 2, step_of(start), count, rules, progress)
    left = (1 if stop >= 0 else 0) + (1 if stretches.place[part] < 0 else 0)
    return freed - 2 * left, size


@jit
def _freed_by(written: tuple[int, int], watched: IntArray, follows: IntArray, queue: list[int],
              rules: Rules, progress: Progress, stretches: Stretches) -> None:  # fmt: skip
    """Add the starts that may go on after a stretch has been written."""
    start, count = written
    for n in range(count):
        element = start // 2 + step_of(start) * n
        for k in range(rules.begin[element], rules.begin[element + 1]):
            after = rules.after[k]
            other = watched[after]
            while other >= 0:
                if progress.waiting[after] <= stretches.until[other]:
                    queue.append(other)
                other = follows[other]


# Extend a writing stroke through nodes by the straightest unwritten vessel stretches.


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


# Track unwritten stretches of vessels, and test if each can be written in one stroke.

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
