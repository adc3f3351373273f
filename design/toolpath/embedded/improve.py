"""Rounds of ordering: what a round couldn't close becomes a rule of the next."""

from __future__ import annotations

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.joined import Joined
from design.toolpath.embedded.joints import Joiner
from design.toolpath.embedded.rules import Rules, one_way, with_more
from design.toolpath.embedded.schedule import Pass, Scheduler
from design.toolpath.toolpath import IntArray

ROUNDS = 8


def ordered(
    elements: Elements, rules: Rules, head: IntArray, joiner: Joiner
) -> tuple[list[Pass], Joined]:
    """Passes in their order and how they join; the best of all rounds.

    A joint stays open when ink written meanwhile stands in the way of its overlap. The next round
    writes the later stretch before that ink, and what brushed an overlap before that; unless a rule
    of the shaft's says the opposite.
    """
    asked = one_way(rules, elements.vessel)
    best: tuple[tuple[int, ...], list[Pass], Joined] | None = None
    for _ in range(ROUNDS):
        passes = Scheduler(elements, asked, head).run()
        joined = joiner.join(passes)
        harm = len(broken(rules, passes)[0]), len(joined.open), len(joined.brushed)
        score = *harm, len(joined.shortened), len(passes)
        if best is None or score < best[0]:
            best = score, passes, joined
        first, after = np.array(joined.wishes, dtype=np.int64).reshape(-1, 2).T
        known, asked = asked, with_more(asked, first, after)
        if len(asked.after) == len(known.after):
            break
    assert best is not None
    return best[1], best[2]


def broken(rules: Rules, passes: list[Pass]) -> tuple[IntArray, IntArray]:
    """Elements while which others, written before, stand in the shaft's way."""
    when = np.empty(len(rules.begin) - 1, dtype=np.int64)
    when[np.concatenate([one.elements() for one in passes])] = np.arange(len(when))
    first = np.repeat(np.arange(len(when)), np.diff(rules.begin))
    wrong = when[rules.after] < when[first]
    return first[wrong], rules.after[wrong]
