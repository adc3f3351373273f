"""Merge writing strokes into fewer and longer ones, in an order that keeps the shaft out of ink.

Two passes may become one when no chain of rules leads from the first through others to the second:
what such a chain doesn't hold is written before both, or after.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.pass_rules import (
    PassRules,
    contracted,
    pass_ends,
    pass_rules,
    reverse_pass,
)
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.schedule import Pass
from design.toolpath.embedded.walk import Leg
from kernels import jit
from kernels.arrays import IntArray

TRIES, PATIENCE = 64, 16
"""Times that passes are split and made one in another order; at most so many in vain in a row."""
SPLIT = 0.2
"""Share of the places between two legs at which passes are split."""


def fewest(
    passes: list[Pass],
    elements: Elements,
    rules: Rules,
    head: IntArray,
    random: np.random.Generator,
) -> list[Pass]:
    """Merge passes; then split them here and there and merge again, as long as that saves some.

    Large neighbourhood search (Shaw 1998, LNCS 1520, 417). As many passes in another order are
    taken, too: they lead on to fewer.
    """
    legs = [leg for one in passes for leg in one.legs]
    graph = pass_rules([Pass((leg,)) for leg in legs], elements, rules)
    number = {leg.middle: k for k, leg in enumerate(legs)}
    best, vain = merge_passes(passes, _of_legs(passes, number, graph), elements, head), 0
    for _ in range(TRIES):
        if vain == PATIENCE or len(best) < 3:
            break
        parts = _split(best, elements, random)
        tried = merge_passes(parts, _of_legs(parts, number, graph), elements, head, random)
        vain = 0 if len(tried) < len(best) else vain + 1
        best = tried if len(tried) <= len(best) else best
    return [_in_one(one, elements) for one in best]


def _of_legs(passes: list[Pass], number: dict[int, int], graph: PassRules) -> PassRules:
    """Rules of passes, from those of their legs, which ``number`` knows by their middles."""
    own = np.empty(len(number), dtype=np.int64)
    for k, one in enumerate(passes):
        for leg in one.legs:
            own[number[leg.middle]] = k
    return contracted(graph, own)


def merge_passes(
    passes: list[Pass],
    graph: PassRules,
    elements: Elements,
    head: IntArray,
    random: np.random.Generator | None = None,
) -> list[Pass]:
    """Fewer passes in an order that keeps the same rules; `random` chooses which come first."""
    ends = np.array([pass_ends(one, elements) for one in passes], dtype=np.int64)
    tool = np.array([head[elements.vessel[one.legs[0].element]] for one in passes])
    while len(passes) > 1:
        pairs = _pairs(ends, tool, graph.turns)
        if random is not None:
            pairs = pairs[random.permutation(len(pairs))]
        order, chosen = _merge(len(passes), pairs, graph)
        if not len(chosen):
            break
        pairs = pairs[chosen]
        passes = _rebuilt(passes, order, pairs)
        one, side, other, there = pairs.T
        ends[one] = np.column_stack([ends[one, 1 - side], ends[other, 1 - there]])
        stays = ~np.isin(order, other)
        number = np.empty(len(order), dtype=np.int64)
        number[order] = np.cumsum(stays) - 1  # a pass follows that into which it has gone
        ends, tool, graph = ends[order[stays]], tool[order[stays]], contracted(graph, number)
    return passes


def _split(passes: list[Pass], elements: Elements, random: np.random.Generator) -> list[Pass]:
    """Cut passes at some of their nodes; a vessel once written in a row stays so."""
    cut = iter((random.random(sum(len(one.legs) for one in passes)) < SPLIT).tolist())
    parts: list[Pass] = []
    for one in passes:
        begin, cuts = 0, [next(cut) for _ in one.legs]
        for k in range(1, len(cuts)):
            if cuts[k] and not _goes_on(one.legs[k - 1], one.legs[k], elements):
                parts.append(Pass(one.legs[begin:k]))
                begin = k
        parts.append(Pass(one.legs[begin:]))
    return parts


def _pairs(ends: IntArray, tool: IntArray, turns: NDArray[np.bool_]) -> IntArray:
    """Passes of which one can end where the other begins, those nearest in the order first.

    (k, 4): the one to be written first, which of its ends (0, 1), the next, and which of its. That
    is the later one first where neither can be turned so that the earlier leads on to it.
    """
    pairs = _meeting(ends.ravel(), np.argsort(ends.ravel(), kind="stable"), tool, turns)
    return pairs[np.lexsort((*pairs.T[::-1], abs(pairs[:, 2] - pairs[:, 0])))]


@jit
def _meeting(point: IntArray, rows: IntArray, tool: IntArray, turns: NDArray[np.bool_]) -> IntArray:
    """Rows of `_pairs`; ``point`` (2 p,) of each pass's both ends, ``rows`` sorted by these."""
    pairs = [(0, 0, 0, 0)][:0]
    for k in range(len(rows)):
        one, side = rows[k] // 2, rows[k] % 2
        for m in range(k + 1, len(rows)):
            if point[rows[m]] != point[rows[k]]:
                break
            other, there = rows[m] // 2, rows[m] % 2
            if one == other or tool[one] != tool[other]:
                continue
            if (side == 1 or turns[one]) and (there == 0 or turns[other]):
                pairs.append((one, side, other, there))
            elif (there == 1 or turns[other]) and (side == 0 or turns[one]):
                pairs.append((other, there, one, side))
    out = np.empty((len(pairs), 4), np.int64)
    for k in range(len(pairs)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = pairs[k]
    return out


def _rebuilt(passes: list[Pass], order: IntArray, chosen: IntArray) -> list[Pass]:
    follows = {row[0]: row[1:] for row in chosen.tolist()}
    gone = set(chosen[:, 2].tolist())
    rebuilt = []
    for number in order.tolist():
        one = passes[number]
        if number in follows:
            side, other, there = follows[number]
            head = one if side == 1 else reverse_pass(one)
            tail = passes[other] if there == 0 else reverse_pass(passes[other])
            one = Pass(head.legs + tail.legs)
        if number not in gone:
            rebuilt.append(one)
    return rebuilt


def _in_one(one: Pass, elements: Elements) -> Pass:
    """The same pass; legs that go on along the same vessel are one."""
    legs = [one.legs[0]]
    for leg in one.legs[1:]:
        last = legs[-1]
        if _goes_on(last, leg, elements):
            legs[-1] = Leg(last.element, last.step, last.size + leg.size)
        else:
            legs.append(leg)
    return Pass(tuple(legs))


def _goes_on(leg: Leg, after: Leg, elements: Elements) -> bool:
    """Whether a leg begins in the same vessel where one ends."""
    row = leg.last + leg.step == after.element and leg.step == after.step
    return row and bool(elements.vessel[leg.last] == elements.vessel[after.element])


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
