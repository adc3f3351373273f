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
from design.toolpath.embedded.order.stretches import (
    Ends,
    Progress,
    Stretches,
    close_written,
    ends_of,
    first_of,
    going_on,
    is_whole,
    none_open,
    open_stretch,
    start_walk,
    step_of,
    undo_write,
    vertex,
    write_stretch,
)
from design.toolpath.embedded.rules import Rules
from kernels import jit
from kernels.arrays import FloatArray, IntArray


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
