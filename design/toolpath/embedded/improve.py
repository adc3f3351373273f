"""Rounds of ordering: what a round couldn't close becomes a rule of the next."""

from __future__ import annotations

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.joints import Joined, Joiner
from design.toolpath.embedded.rules import Rules, one_way, with_more
from design.toolpath.embedded.schedule import Pass, Scheduler
from design.toolpath.toolpath import IntArray

ROUNDS = 8


def ordered(
    elements: Elements, rules: Rules, head: IntArray, joiner: Joiner
) -> tuple[list[Pass], Joined]:
    """Passes in their order and how they join; the best of all rounds.

    A joint stays open when ink written meanwhile stands in the way of its overlap. The next round
    writes the later stretch before that ink, if that breaks no rule of the shaft's.
    """
    asked = one_way(rules)
    best: tuple[tuple[int, int, int], list[Pass], Joined] | None = None
    for _ in range(ROUNDS):
        passes = Scheduler(elements, asked, head).run()
        joined = joiner.join(passes)
        score = len(broken(rules, passes)[0]), len(joined.open), len(passes)
        if best is None or score < best[0]:
            best = score, passes, joined
        if not joined.open:
            break
        pairs = [(o.element, int(k)) for o in joined.open for k in o.barred_by]
        first, after = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        asked = with_more(asked, first, after)
    assert best is not None
    return best[1], best[2]


def broken(rules: Rules, passes: list[Pass]) -> tuple[IntArray, IntArray]:
    """Elements while which others, written before, stand in the shaft's way."""
    when = np.empty(len(rules.begin) - 1, dtype=np.int64)
    when[np.concatenate([one.elements() for one in passes])] = np.arange(len(when))
    first = np.repeat(np.arange(len(when)), np.diff(rules.begin))
    wrong = when[rules.after] < when[first]
    return first[wrong], rules.after[wrong]
