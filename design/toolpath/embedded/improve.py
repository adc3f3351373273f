"""Order writing strokes in rounds, each with added rules for open joints; keep the best order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.joints import Joiner
from design.toolpath.embedded.merge import fewest, shorten_travels
from design.toolpath.embedded.report import JoinedPasses
from design.toolpath.embedded.rules import Rules, one_way, with_more
from design.toolpath.embedded.schedule import Pass, Scheduler
from kernels.arrays import IntArray

ROUNDS, PATIENCE = 8, 3
"""At most so many, and so many that are no better than the best before."""
WORK, LARGE = 100_000, 20_000
"""Elements that all rounds may order together; of more than that there is one: what a large network
leaves open after its first round is open by its design."""


class _Way(NamedTuple):
    """How passes are laid: whether they are merged, and moved for shorter ways between them."""

    merge: bool
    shorten: bool


WAYS = (_Way(True, True), _Way(False, True), _Way(False, False))
"""Tried in turn as long as joints stay open."""


@dataclass(frozen=True)
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
    asked = one_way(rules, elements.vessel)
    best: _Order | None = None
    for way in WAYS if _rounds(elements) > 1 else WAYS[:1]:
        one = _best_round(Scheduler(elements, asked, head, out), rules, joiner, way)
        best = one if best is None else min(best, one, key=_score)
        if not best.joined.open:
            break
    assert best is not None
    return best.passes, best.joined


def _best_round(scheduler: Scheduler, rules: Rules, joiner: Joiner, way: _Way) -> _Order:
    elements, asked, head = scheduler.elements, scheduler.rules, scheduler.head
    best: _Order | None = None
    since, random = 0, np.random.default_rng(0)
    for _ in range(_rounds(elements)):
        passes = replace(scheduler, rules=asked).run()
        if way.merge:
            passes = fewest(passes, elements, asked, head, random)
        if way.shorten:
            passes = shorten_travels(passes, elements, asked, head)
        one = _judged(passes, rules, joiner)
        if best is None or _score(one) < _score(best):
            best, since = one, 0
        else:
            since += 1
        first, after = np.array(one.joined.reorderings, dtype=np.int64).reshape(-1, 2).T
        known, asked = asked, with_more(asked, first, after)
        if len(asked.after) == len(known.after) or since == PATIENCE:
            break
    assert best is not None
    return best


def _rounds(elements: Elements) -> int:
    count = len(elements.end)
    return 1 if count > LARGE else min(WORK // count, ROUNDS)


def _score(one: _Order) -> tuple[tuple[int, ...], int]:
    return one.harm, len(one.passes)


def _judged(passes: list[Pass], rules: Rules, joiner: Joiner) -> _Order:
    joined = joiner.join(passes)
    weak = len(joined.open), len(joined.brushed), len(joined.shortened)
    return _Order(passes, joined, (len(broken_rules(rules, passes)[0]), *weak))


def broken_rules(rules: Rules, passes: list[Pass]) -> tuple[IntArray, IntArray]:
    """Elements while which others, written before, stand in the shaft's way."""
    when = np.empty(len(rules.begin) - 1, dtype=np.int64)
    order = np.concatenate([one.elements() for one in passes])
    when[order] = np.arange(len(order))
    first = np.repeat(np.arange(len(when)), np.diff(rules.begin))
    wrong = when[rules.after] < when[first]
    return first[wrong], rules.after[wrong]
