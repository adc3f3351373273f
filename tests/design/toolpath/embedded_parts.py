"""Embedded planner's preparatory steps, called one by one for tests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.elements import Elements, ElementSquares, elements_of, squares_of
from design.toolpath.embedded.needle import Needle
from design.toolpath.embedded.rules import Meetings, Rules, at_nodes, with_touches
from design.toolpath.embedded.schedule import Pass
from design.toolpath.embedded.touches import Touches, touches


class Parts(NamedTuple):
    elements: Elements
    squares: ElementSquares
    touches: Touches
    meetings: Meetings
    needle: Needle


def parts_of(net: VesselNetwork, options: EmbeddedOptions, longest_mm: float = 0.1) -> Parts:
    bare = options.tip_mm - options.clearance_mm
    needle = Needle(
        bare,
        bare,
        options.tip_mm,
        options.shaft_mm,
        options.cone_mm,
        options.overlap_radii,
    )
    elements = elements_of(net, longest_mm)
    squares = squares_of(elements, needle.shaft_mm)
    nodes = at_nodes(net, elements)
    found = touches(net, needle)
    return Parts(elements, squares, found, with_touches(nodes, found, elements), needle)


def rules_of(pairs: dict[tuple[int, int], float], count: int) -> Rules:
    """Rules from (first, after) and their depth."""
    first, after = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2).T
    begin = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=count))])
    depth = np.array([pairs[pair] for pair in sorted(pairs)], dtype=np.float64)
    return Rules(begin.astype(np.int64), after.copy(), depth)


def pairs_of(rules: Rules) -> dict[tuple[int, int], float]:
    """(first, after) and depth of every rule."""
    first = np.repeat(np.arange(len(rules.begin) - 1), np.diff(rules.begin))
    rows = zip(first.tolist(), rules.after.tolist(), rules.harm.tolist(), strict=True)
    return {(i, j): depth for i, j, depth in rows}


def trail(one: Pass, elements: Elements) -> list[int]:
    """Points that a pass goes through; fails where it jumps."""
    points: list[int] = []
    for leg in one.legs:
        for element in leg.elements().tolist():
            tail, head = elements.end[element].tolist()
            here, there = (tail, head) if leg.step > 0 else (head, tail)
            assert not points or points[-1] == here
            points = points or [here]
            points.append(there)
    return points
