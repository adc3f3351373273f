"""Reorder and reverse writing strokes for shorter travels, with the shaft kept out of ink.

Or-opt (Or 1976) with precedence: runs of up to `RUN` passes go where they make the way shortest, as
long as every rule between two passes is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.pass_rules import PassRules, pass_ends, pass_rules, reverse_pass
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.schedule import Pass
from kernels import jit
from kernels.arrays import FloatArray, IntArray

CLIMB = 4.0
"""A millimetre up or down takes as long as so many across, at the usual 5 and 20 mm/s."""
RUN = 3
SWEEPS = 12
OTHER_HEAD_MM = 1000.0
"""A change of heads costs as much as so long a way."""

Flags = NDArray[np.bool_]


def shorten_travels(
    passes: list[Pass], elements: Elements, rules: Rules, head: IntArray
) -> list[Pass]:
    """The passes in an order, and each in the direction, that makes the ways between them short."""
    if len(passes) < 3:
        return passes
    graph = pass_rules(passes, elements, rules)
    ends = elements.point[np.array([pass_ends(one, elements) for one in passes])]
    tool = np.array([head[elements.vessel[one.legs[0].element]] for one in passes])
    order, back = np.arange(len(passes)), np.zeros(len(passes), dtype=np.bool_)
    _improve(order, back, ends, tool, graph)
    return [reverse_pass(passes[k]) if back[k] else passes[k] for k in order.tolist()]


@jit
def _way(one: int, back: bool, other: int, turned: bool, ends: FloatArray, tool: IntArray) -> float:
    """From the end of a pass, or its start if it runs backward, to where another begins, mm."""
    a, b = ends[one, 0 if back else 1], ends[other, 1 if turned else 0]
    way = np.hypot(a[0] - b[0], a[1] - b[1]) + CLIMB * abs(a[2] - b[2])
    return float(way + (OTHER_HEAD_MM if tool[one] != tool[other] else 0.0))


@jit
def _improve(
    order: IntArray, turned: Flags, ends: FloatArray, tool: IntArray, graph: PassRules
) -> None:
    """Move runs of passes, in `order` and `reverse_pass` themselves, until nothing gets shorter.

    After the first sweep only passes beside which the order has changed are looked at again.
    """
    place, now = np.arange(len(order)), np.ones(len(order), dtype=np.bool_)
    for _ in range(SWEEPS):
        changed = False
        later = np.zeros(len(order), dtype=np.bool_)
        for low in range(len(order)):
            for size in range(1, min(RUN, len(order) - low) + 1):
                if not _any(now, later, order, low, size):
                    continue
                to, back = _best_place(low, size, order, turned, place, ends, tool, graph)
                if to >= 0:
                    _touch(later, order, low, low + size)
                    _touch(later, order, to, to)
                    _move(low, size, to, back, order, turned, place)
                    changed = True
        now = later
        if not changed:
            return


@jit
def _any(now: Flags, later: Flags, order: IntArray, low: int, size: int) -> bool:
    """Whether one of a run of passes is to be looked at."""
    wanted = False
    for k in range(low, low + size):
        wanted |= now[order[k]] or later[order[k]]
    return wanted


@jit
def _touch(flags: Flags, order: IntArray, low: int, high: int) -> None:
    """Mark passes from one before a place to one behind another."""
    for k in range(max(low - 1, 0), min(high + 1, len(order))):
        flags[order[k]] = True


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
    low: int, high: int, order: IntArray, place: IntArray, graph: PassRules
) -> tuple[int, int]:
    """First and last place before which the run from ``low`` to ``high - 1`` may stand."""
    first, last = 0, len(order)
    for k in range(low, high):
        p = order[k]
        for m in range(graph.before_begin[p], graph.before_begin[p + 1]):
            if not low <= place[graph.before[m]] < high:
                first = max(first, place[graph.before[m]] + 1)
        for m in range(graph.after_begin[p], graph.after_begin[p + 1]):
            if not low <= place[graph.after[m]] < high:
                last = min(last, place[graph.after[m]])
    return first, last


@jit
def _best_place(
    low: int, size: int, order: IntArray, turned: Flags, place: IntArray, ends: FloatArray,
    tool: IntArray, graph: PassRules,
) -> tuple[int, bool]:  # fmt: skip
    """Where a run had better go: before which place, and whether turned round; -1 for nowhere."""
    high = low + size
    first, last = _window(low, high, order, place, graph)
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
            if (flip and (size > 1 or not graph.turns[p])) or (stays and not flip):
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
