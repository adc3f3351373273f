"""Find places within passes to look for gaps, before later ink bars the needle's way to them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from design.toolpath.embedded.elements import Elements, squares_of
from design.toolpath.embedded.needle import Needle
from design.toolpath.embedded.rules import Meetings, Rules, find_rules
from design.toolpath.embedded.schedule import Pass
from kernels.arrays import IntArray

MEND_OVERLAP_RADII: Final = 0.5
"""Reach of the joint that mends are judged by (`printctl.observe.mending`), in radii."""


def look_places(passes: Sequence[Pass], elements: Elements, needle: Needle) -> frozenset[int]:
    """Return the elements before which a print should be looked at; never a pass's first one.

    A needle that mends an element stands where it stood when that was written, and meets what the
    pass has written since: beyond some 54 degrees a pass bars the way to itself. A look is due
    before the first element that bars one written since the last look. So all that a look is the
    first to see can be reached in it.

    As in a mend, of which each pass is one path, the bare needle counts, and ink is spared by its
    way along the pass alone: nodes within it are no joints of their own.

    Parameters
    ----------
    passes : sequence of Pass
        In their order.
    elements : Elements
    needle : Needle
        With its clearance.
    """
    order = np.concatenate([one.elements() for one in passes])
    written = _as_written(passes, elements)
    mends = needle.bare()._replace(overlap_radii=MEND_OVERLAP_RADII)
    rules = find_rules(written, squares_of(written, mends.shaft_mm), _none(len(passes)), mends)
    first = written.first.tolist()
    return frozenset(
        int(order[at]) for low, high in pairwise(first) for at in _in_pass(low, high, rules)
    )


def _as_written(passes: Sequence[Pass], elements: Elements) -> Elements:
    """Elements in the order and direction of writing, each pass a vessel of its own."""
    order = np.concatenate([one.elements() for one in passes])
    legs = [leg for one in passes for leg in one.legs]
    backwards = np.repeat([leg.step < 0 for leg in legs], [leg.size for leg in legs])[:, None]
    count = [sum(leg.size for leg in one.legs) for one in passes]
    first = np.concatenate([[0], np.cumsum(count)])
    number = np.repeat(np.arange(len(passes)), count)
    end, radius, length = elements.end[order], elements.radius[order], elements.length[order]
    way = np.cumsum(length) - length
    arc = way - way[first[:-1]][number]
    return Elements(
        elements.point,
        np.where(backwards, end[:, ::-1], end),
        np.where(backwards, radius[:, ::-1], radius),
        length,
        arc,
        np.column_stack([arc, arc + length]),
        number,
        first,
    )


def _none(vessels: int) -> Meetings:
    """No joints but those along a vessel."""
    nothing = np.zeros(0)
    begin = np.zeros(vessels + 1, dtype=np.int64)
    return Meetings(begin, nothing, np.zeros(0, dtype=np.int64), nothing, nothing)


def _in_pass(low: int, high: int, rules: Rules) -> list[int]:
    """Those of a pass whose elements are ``low`` to ``high - 1``."""
    barred = np.full(high - low, -1, dtype=np.int64)  # the last one before that each bars
    for element in range(low, high):
        later: IntArray = rules.after[rules.begin[element] : rules.begin[element + 1]]
        barred[later[(later > element) & (later < high)] - low] = element
    looked, places = low, list[int]()
    for element in range(low + 1, high):
        if barred[element - low] >= looked:
            looked = element
            places.append(element)
    return places
