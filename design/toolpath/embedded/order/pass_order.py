"""Merge writing strokes into fewer and longer ones, in an order that keeps the shaft out of ink.

Two passes may become one when no chain of rules leads from the first through others to the second:
what such a chain doesn't hold is written before both, or after.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.order.joints import Joiner
from design.toolpath.embedded.order.pass_rules import (
    PassRules,
    contracted,
    pass_ends,
    pass_rules,
    reverse_pass,
)
from design.toolpath.embedded.order.schedule import Leg, Pass, schedule_passes
from design.toolpath.embedded.report import JoinedPasses
from design.toolpath.embedded.rules import Rules, one_way, with_more
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class SearchLimits:
    """Limits of the search for an order of passes."""

    merges: int = 64  # times that passes are split and merged again
    useless_merges: int = 16  # of these, in vain in a row
    split_share: float = 0.2  # share of the places between two legs at which passes are split
    rounds: int = 8  # orders tried of one way to lay passes
    useless_rounds: int = 3  # of these, no better than the best in a row
    ordered_elements: int = 100_000  # that all rounds may order together
    # Of more elements there is one round: what a large network leaves open is open by its design.
    large: int = 20_000


LIMITS = SearchLimits()


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
    for _ in range(LIMITS.merges):
        if vain == LIMITS.useless_merges or len(best) < 3:
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
    cut = iter((random.random(sum(len(one.legs) for one in passes)) < LIMITS.split_share).tolist())
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


class _TravelCosts(NamedTuple):
    """What travels cost, and how far their order is searched.

    Or-opt (Or 1976) with precedence: runs of up to three passes go where they make the way
    shortest, as long as every rule between two passes is kept.
    """

    climb: float = 4.0  # mm across that take as long as 1 mm up or down, at 20 and 5 mm/s
    other_head_mm: float = 1000.0  # way that costs as much as a change of heads
    run: int = 3  # passes moved together, at most
    sweeps: int = 12  # over all passes, at most


TRAVEL: Final = _TravelCosts()
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


def placed(
    passes: list[Pass], one: Pass, elements: Elements, rules: Rules, head: IntArray
) -> list[Pass] | None:
    """Passes with one more behind the nearest that it may follow; None where it has no place."""
    one = min(one, reverse_pass(one), key=lambda each: len(broken_rules(rules, [each])[0]))
    last, every = len(passes), [*passes, one]
    order = np.arange(last + 1)
    first, end = _window(last, last + 1, order, order, pass_rules(every, elements, rules))
    if first > end or len(broken_rules(rules, [one])[0]):
        return None
    ends = elements.point[np.array([pass_ends(each, elements) for each in every])]
    tool = np.array([head[elements.vessel[each.legs[0].element]] for each in every])
    gaps = range(max(first, 1), min(end, last) + 1)
    at = min(gaps, key=lambda k: _way(k - 1, False, last, False, ends, tool), default=0)
    return [*passes[:at], one, *passes[at:]]


@jit
def _way(one: int, back: bool, other: int, turned: bool, ends: FloatArray, tool: IntArray) -> float:
    """From the end of a pass, or its start if it runs backward, to where another begins, mm."""
    a, b = ends[one, 0 if back else 1], ends[other, 1 if turned else 0]
    way = np.hypot(a[0] - b[0], a[1] - b[1]) + TRAVEL.climb * abs(a[2] - b[2])
    return float(way + (TRAVEL.other_head_mm if tool[one] != tool[other] else 0.0))


@jit
def _improve(
    order: IntArray, turned: Flags, ends: FloatArray, tool: IntArray, graph: PassRules
) -> None:
    """Move runs of passes, in `order` and `reverse_pass` themselves, until nothing gets shorter.

    After the first sweep only passes beside which the order has changed are looked at again.
    """
    place, now = np.arange(len(order)), np.ones(len(order), dtype=np.bool_)
    for _ in range(TRAVEL.sweeps):
        changed = False
        later = np.zeros(len(order), dtype=np.bool_)
        for low in range(len(order)):
            for size in range(1, min(TRAVEL.run, len(order) - low) + 1):
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


WAYS = ((True, True), (False, True), (False, False))
"""Whether passes are merged, and moved for shorter travels: tried in turn as long as joints stay
open. Of 91 plans measured three end with a better scored order by the later ways."""


@dataclass(frozen=True, eq=False)
class _Order:
    """Passes in an order, how they join, and what is wrong with it, the worst first."""

    passes: list[Pass]
    joined: JoinedPasses
    harm: tuple[int, int, int, int]


def order_passes(
    elements: Elements,
    rules: Rules,
    head: IntArray,
    joiner: Joiner,
    out: NDArray[np.bool_] | None = None,
) -> tuple[list[Pass], JoinedPasses]:
    """Passes in their order and how they join; the best of all rounds, its ways made short.

    Elements that are ``out`` (n,) aren't written; no rule names them.

    A joint stays open when ink written meanwhile stands in the way of its overlap. The next round
    writes the later stretch before that ink, and what brushed an overlap before that; unless a rule
    of the shaft's says the opposite.
    """
    one_order = one_way(rules, elements.vessel)
    rounds, orders = _rounds(elements), list[_Order]()
    for merge, shorten in WAYS if rounds > 1 else WAYS[:1]:
        asked, first_try = one_order, len(orders)
        random = np.random.default_rng(0)
        for _ in range(rounds):
            passes = schedule_passes(elements, asked, head, out)
            if merge:
                passes = fewest(passes, elements, asked, head, random)
            if shorten:
                passes = shorten_travels(passes, elements, asked, head)
            orders.append(_judged(passes, rules, joiner))
            useless = len(orders) - 1 - orders.index(min(orders[first_try:], key=_score))
            first, after = np.array(orders[-1].joined.reorderings, dtype=np.int64).reshape(-1, 2).T
            known, asked = asked, with_more(asked, first, after)
            if len(asked.after) == len(known.after) or useless == LIMITS.useless_rounds:
                break
        if not min(orders, key=_score).joined.open:
            break
    best = min(orders, key=_score)
    return best.passes, best.joined


def _rounds(elements: Elements) -> int:
    count = len(elements.end)
    return 1 if count > LIMITS.large else min(LIMITS.ordered_elements // count, LIMITS.rounds)


def _score(one: _Order) -> tuple[tuple[int, ...], int]:
    return one.harm, len(one.passes)


def _judged(passes: list[Pass], rules: Rules, joiner: Joiner) -> _Order:
    joined = joiner.join(passes)
    weak = len(joined.open), len(joined.brushed), len(joined.shortened)
    return _Order(passes, joined, (len(broken_rules(rules, passes)[0]), *weak))


def broken_rules(rules: Rules, passes: list[Pass]) -> tuple[IntArray, IntArray]:
    """Elements while which others, written before, stand in the shaft's way."""
    when = np.full(len(rules.begin) - 1, np.nan)
    order = np.concatenate([one.elements() for one in passes])
    when[order] = np.arange(len(order))
    first = np.repeat(np.arange(len(when)), np.diff(rules.begin))
    wrong = when[rules.after] < when[first]
    return first[wrong], rules.after[wrong]
