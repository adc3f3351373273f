"""Merge embedded writing passes that can be made in one stroke.

Two passes may become one when no chain of rules leads from the first through others to the second:
what such a chain doesn't hold is written before both, or after.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.pass_rules import PassRules, pass_ends, pass_rules, turned
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.schedule import Pass
from design.toolpath.embedded.walk import Leg
from design.toolpath.toolpath import IntArray
from kernels import jit

TRIES, PATIENCE = 16, 3
"""Times that passes are split and made one in another order; at most so many in vain in a row."""
AT_NODES, WITHIN = 0.25, 0.05
"""Of a pass's nodes, and of its legs, the share at which it is split."""


def fewest(
    passes: list[Pass],
    elements: Elements,
    rules: Rules,
    head: IntArray,
    random: np.random.Generator,
) -> list[Pass]:
    """Merge passes; then split them here and there and merge again, as long as that saves some.

    Large neighbourhood search (Shaw 1998, LNCS 1520, 417).
    """
    best, vain = merged(passes, elements, rules, head), 0
    for _ in range(TRIES):
        if vain == PATIENCE or len(best) < 3:
            break
        tried = merged(_split(best, random), elements, rules, head, random)
        vain = 0 if len(tried) < len(best) else vain + 1
        best = tried if len(tried) < len(best) else best
    return best


def merged(
    passes: list[Pass],
    elements: Elements,
    rules: Rules,
    head: IntArray,
    random: np.random.Generator | None = None,
) -> list[Pass]:
    """Fewer passes in an order that keeps the same rules; `random` chooses which come first."""
    while len(passes) > 1:
        graph = pass_rules(passes, elements, rules)
        ends = [pass_ends(one, elements) for one in passes]
        tool = [int(head[elements.vessel[one.legs[0].element]]) for one in passes]
        pairs = _pairs(ends, tool, graph.turns)
        if random is not None:
            pairs = pairs[random.permutation(len(pairs))]
        order, chosen = _merge(len(passes), pairs, graph)
        if not len(chosen):
            break
        passes = _rebuilt(passes, elements, order, pairs[chosen])
    return passes


def _split(passes: list[Pass], random: np.random.Generator) -> list[Pass]:
    found: list[Pass] = []
    for one in passes:
        legs: list[Leg] = []
        draws = random.random((len(one.legs), 3))
        for leg, (node, within, at) in zip(one.legs, draws.tolist(), strict=True):
            if legs and node < AT_NODES:
                found.append(Pass(tuple(legs)))
                legs = []
            cut = 1 + int(at * (leg.size - 1))
            if within < WITHIN and cut < leg.size:
                found.append(Pass((*legs, Leg(leg.element, leg.step, cut))))
                legs = []
                leg = Leg(leg.element + leg.step * cut, leg.step, leg.size - cut)
            legs.append(leg)
        found.append(Pass(tuple(legs)))
    return found


def _pairs(ends: list[tuple[int, int]], tool: list[int], turns: NDArray[np.bool_]) -> IntArray:
    """Passes of which one can end where the other begins, those nearest in the order first.

    (k, 4): the one to be written first, which of its ends (0, 1), the next, and which of its. That
    is the later one first where neither can be turned so that the earlier leads on to it.
    """
    at: dict[int, list[tuple[int, int]]] = {}
    for number, pair in enumerate(ends):
        for side, point in enumerate(pair):
            at.setdefault(point, []).append((number, side))
    found = []
    for meet in at.values():
        for k, (one, side) in enumerate(meet):
            for other, there in meet[k + 1 :]:
                if one == other or tool[one] != tool[other]:
                    continue
                if (side == 1 or turns[one]) and (there == 0 or turns[other]):
                    found.append((one, side, other, there))
                elif (there == 1 or turns[other]) and (side == 0 or turns[one]):
                    found.append((other, there, one, side))
    found.sort(key=lambda p: (abs(p[2] - p[0]), p))
    return np.array(found, dtype=np.int64).reshape(-1, 4)


def _rebuilt(
    passes: list[Pass], elements: Elements, order: IntArray, chosen: IntArray
) -> list[Pass]:
    follows = {row[0]: row[1:] for row in chosen.tolist()}
    gone = set(chosen[:, 2].tolist())
    found = []
    for number in order.tolist():
        one = passes[number]
        if number in follows:
            side, other, there = follows[number]
            head = one if side == 1 else turned(one)
            tail = passes[other] if there == 0 else turned(passes[other])
            one = _one(head, tail, elements)
        if number not in gone:
            found.append(one)
    return found


def _one(one: Pass, other: Pass, elements: Elements) -> Pass:
    """Both in a row; legs that go on along the same vessel are one."""
    last, leg = one.legs[-1], other.legs[0]
    same = elements.vessel[last.last] == elements.vessel[leg.element]
    if same and last.step == leg.step and last.last + last.step == leg.element:
        joined = Leg(last.element, last.step, last.size + leg.size)
        return Pass((*one.legs[:-1], joined, *other.legs[1:]))
    return Pass(one.legs + other.legs)


@jit
def _merge(count: int, pairs: IntArray, graph: PassRules) -> tuple[IntArray, IntArray]:
    """An order of the passes, and rows of pairs that stand together in it; each pass once."""
    order, place = np.arange(count), np.arange(count)
    used = np.zeros(count, dtype=np.bool_)
    mark = np.full(count, -1)
    partner = np.full(count, -1)
    chosen = [0][:0]
    for k in range(len(pairs)):
        one, other = pairs[k, 0], pairs[k, 2]
        if used[one] or used[other]:
            continue
        swaps = place[one] > place[other]
        early, late = (other, one) if swaps else (one, other)
        if not _free_between(early, late, swaps, order, place, mark, partner, k, graph):
            continue
        _move_together(early, late, swaps, order, place, mark, k)
        used[one] = used[other] = True
        partner[one], partner[other] = other, one
        chosen.append(k)
    return order, np.array(chosen, np.int64)


@jit
def _free_between(one: int, other: int, swaps: bool, order: IntArray, place: IntArray,
                  mark: IntArray, partner: IntArray, tag: int,
                  graph: PassRules) -> bool:  # fmt: skip
    """Whether no chain of rules leads from a pass through others to another; marks the chain.

    Nor one straight from pass to pass, where they are to swap. Passes already made one share their
    rules.
    """
    mark[one] = tag
    for k in range(place[one], place[other]):
        here = order[k]
        mate = partner[here]
        if mate >= 0 and mark[mate] == tag:
            mark[here] = tag
        if mark[here] != tag:
            continue
        if mate >= 0:  # it stands next to it: both move together
            mark[mate] = tag
        for row in (here, mate):
            if row < 0:
                continue
            for m in range(graph.after_begin[row], graph.after_begin[row + 1]):
                after = graph.after[m]
                if after == other and (swaps or here != one):
                    return False
                if after != other:
                    mark[after] = tag
    return True


@jit
def _move_together(
    one: int, other: int, swaps: bool, order: IntArray, place: IntArray, mark: IntArray, tag: int
) -> None:
    """Put both next to each other: after what the first doesn't bar, before what it does."""
    low, high = place[one], place[other]
    kept = [0][:0]
    later = [0][:0]
    for k in range(low + 1, high):
        here = order[k]
        if mark[here] == tag:
            later.append(here)
        else:
            kept.append(here)
    at = low
    for here in kept:
        order[at], place[here] = here, at
        at += 1
    for here in (other, one) if swaps else (one, other):
        order[at], place[here] = here, at
        at += 1
    for here in later:
        order[at], place[here] = here, at
        at += 1
