"""Shorter ways between passes: those that may are moved in their order, or turned round.

Or-opt (Or 1976) with precedence: runs of up to `RUN` passes go where they make the way shortest, as
long as every rule between two passes is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.schedule import Pass
from design.toolpath.embedded.walk import Leg
from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit

CLIMB = 4.0
"""A millimetre up or down takes as long as so many across, at the usual 5 and 20 mm/s."""
RUN = 3
SWEEPS = 12
OTHER_HEAD_MM = 1000.0
"""A change of heads costs as much as so long a way."""

Flags = NDArray[np.bool_]


def with_shorter_ways(
    passes: list[Pass], elements: Elements, rules: Rules, head: IntArray
) -> list[Pass]:
    """The passes in an order, and each in the direction, that makes the ways between them short."""
    if len(passes) < 3:
        return passes
    number = np.empty(len(elements.end), dtype=np.int64)
    for k, one in enumerate(passes):
        number[one.elements()] = k
    first = number[np.repeat(np.arange(len(number)), np.diff(rules.begin))]
    after = number[rules.after]
    turns = np.ones(len(passes), dtype=np.bool_)
    turns[first[first == after]] = False
    before = _grouped(first, after, len(passes))
    ends = np.array([_ends(one, elements) for one in passes])
    tool = np.array([head[elements.vessel[one.legs[0].element]] for one in passes])
    order, turned = np.arange(len(passes)), np.zeros(len(passes), dtype=np.bool_)
    _improve(order, turned, ends, tool, turns, *before, *_grouped(after, first, len(passes)))
    return [_turned(passes[k]) if turned[k] else passes[k] for k in order.tolist()]


def _grouped(one: IntArray, other: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Of each `one` where its `other` begin, and those of all in a row; without repeats."""
    key = np.unique((one * count + other)[one != other])
    begin = np.searchsorted(key, np.arange(count + 1) * count)
    return begin, key % count


def _ends(one: Pass, elements: Elements) -> FloatArray:
    """First and last point of a pass, (2, 3), mm."""
    start, last = one.legs[0], one.legs[-1]
    here = elements.end[start.element, 0 if start.step > 0 else 1]
    there = elements.end[last.last, 1 if last.step > 0 else 0]
    return elements.point[[here, there]]


def _turned(one: Pass) -> Pass:
    return Pass(tuple(Leg(leg.last, -leg.step, leg.size) for leg in one.legs[::-1]))


@jit
def _way(one: int, back: bool, other: int, turned: bool, ends: FloatArray, tool: IntArray) -> float:
    """From the end of a pass, or its start if it runs backward, to where another begins, mm."""
    a, b = ends[one, 0 if back else 1], ends[other, 1 if turned else 0]
    way = np.hypot(a[0] - b[0], a[1] - b[1]) + CLIMB * abs(a[2] - b[2])
    return float(way + (OTHER_HEAD_MM if tool[one] != tool[other] else 0.0))


@jit
def _improve(
    order: IntArray, turned: Flags, ends: FloatArray, tool: IntArray, turns: Flags,
    after_begin: IntArray, after: IntArray, before_begin: IntArray, before: IntArray,
) -> None:  # fmt: skip
    """Move runs of passes, in `order` and `turned` themselves, until nothing gets shorter."""
    place = np.empty(len(order), dtype=np.int64)
    for k in range(len(order)):
        place[order[k]] = k
    for _ in range(SWEEPS):
        changed = False
        for low in range(len(order)):
            for size in range(1, min(RUN, len(order) - low) + 1):
                to, back = _best_place(
                    low, size, order, turned, place, ends, tool, turns,
                    after_begin, after, before_begin, before,
                )  # fmt: skip
                if to >= 0:
                    _move(low, size, to, back, order, turned, place)
                    changed = True
        if not changed:
            return


@jit
def _between(
    a: int, b: int, order: IntArray, turned: Flags, ends: FloatArray, tool: IntArray
) -> float:
    """Way from the pass at place a of the order to that at b; 0 beyond the order's ends."""
    if a < 0 or b >= len(order):
        return 0.0
    return _way(order[a], turned[order[a]], order[b], turned[order[b]], ends, tool)


@jit
def _window(
    low: int, high: int, order: IntArray, place: IntArray,
    after_begin: IntArray, after: IntArray, before_begin: IntArray, before: IntArray,
) -> tuple[int, int]:  # fmt: skip
    """First and last place before which the run from ``low`` to ``high - 1`` may stand."""
    first, last = 0, len(order)
    for k in range(low, high):
        p = order[k]
        for m in range(before_begin[p], before_begin[p + 1]):
            if not low <= place[before[m]] < high:
                first = max(first, place[before[m]] + 1)
        for m in range(after_begin[p], after_begin[p + 1]):
            if not low <= place[after[m]] < high:
                last = min(last, place[after[m]])
    return first, last


@jit
def _best_place(
    low: int, size: int, order: IntArray, turned: Flags, place: IntArray, ends: FloatArray,
    tool: IntArray, turns: Flags, after_begin: IntArray, after: IntArray,
    before_begin: IntArray, before: IntArray,
) -> tuple[int, bool]:  # fmt: skip
    """Where a run had better go: before which place, and whether turned round; -1 for nowhere."""
    high = low + size
    first, last = _window(
        low, high, order, place, after_begin, after, before_begin, before
    )  # fmt: skip
    p, q = order[low], order[high - 1]
    freed = _between(low - 1, low, order, turned, ends, tool)
    freed += _between(high - 1, high, order, turned, ends, tool)
    freed -= _between(low - 1, high, order, turned, ends, tool)
    best, where, back = 1e-9, -1, False
    for to in range(first, last + 1):
        if low < to < high:
            continue
        stays = to in (low, high)
        a, b = (low - 1, high) if stays else (to - 1, to)
        closed = _between(a, b, order, turned, ends, tool)
        for flip in (False, True):
            if (flip and (size > 1 or not turns[p])) or (stays and not flip):
                continue
            cost = -closed
            if a >= 0:
                cost += _way(order[a], turned[order[a]], p, turned[p] != flip, ends, tool)
            if b < len(order):
                cost += _way(q, turned[q] != flip, order[b], turned[order[b]], ends, tool)
            if freed - cost > best:
                best, where, back = freed - cost, to, flip
    return where, back


@jit
def _move(
    low: int, size: int, to: int, back: bool, order: IntArray, turned: Flags, place: IntArray
) -> None:
    """Take a run out of the order and put it before a place of it."""
    run = order[low : low + size].copy()
    if back:
        turned[run[0]] = not turned[run[0]]
    if to > low + size:
        order[low : to - size] = order[low + size : to].copy()
        order[to - size : to] = run
    elif to < low:
        order[to + size : low + size] = order[to:low].copy()
        order[to : to + size] = run
    for k in range(min(low, to), max(low + size, to)):
        place[order[k]] = k
