"""Choose a part of a vessel to write next if no unwritten vessel may be written whole."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.stretches import Stretches, step_of, vertex
from design.toolpath.embedded.walk import Progress, undo_write, write_stretch
from kernels import jit
from kernels.arrays import FloatArray, IntArray

TRIED: Final = 64
"""Cuts that are tried where all wait for each other, the lowest."""
FOLLOWED: Final = 64
"""Stretches that are looked at behind each: what a cut sets free sets others free."""


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
