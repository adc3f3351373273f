"""Move branch points of a polished tree until vessels slightly too wide fit again."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.vasculature.growth.clearances import Clearances
from design.vasculature.growth.index import CellIndex
from design.vasculature.options import Law
from design.vasculature.polish.fit import far_end, node_fits, node_slack
from design.vasculature.polish.relax import commit_node, node_value
from kernels import jit

STEPS = np.array([0.01, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0])
"""Lengths of the pushes tried, over the radius."""

DIRECTIONS = np.array(
    [
        (x, y, z)
        for x in (-1.0, 0.0, 1.0)
        for y in (-1.0, 0.0, 1.0)
        for z in (-1.0, 0.0, 1.0)
        if x or y or z
    ]
)


@jit
def push_wide(
    segments: Any, index: CellIndex, room: Clearances, law: Law, flow_over_drop: float
) -> tuple[int, bool]:
    """Push the ends of all segments that are wider than allowed to where they fit.

    Of the places that fit with the shortest push that helps, the one of least cost is taken.

    Returns
    -------
    int, bool
        How many segments couldn't be helped; whether the index is full (call again).
    """
    left = 0
    for i in range(1, len(segments)):
        s = segments[i]
        if s.radius <= s.allowed:
            continue
        done = 0
        if s.left >= 0:
            done = _push(segments, index, room, law, flow_over_drop, i)
        if done == 0 and s.parent > 0:
            done = _push(segments, index, room, law, flow_over_drop, s.parent)
        if done == 0:
            left += 1
        else:
            s.allowed = np.inf
        if done == 2:
            return left, True
    return left, False


@jit
def _push(
    segments: Any, index: CellIndex, room: Clearances, law: Law, flow_over_drop: float, i: int
) -> int:
    """Push the far end of segment ``i``: 0 no place, 1 done, 2 done and index full."""
    s = segments[i]
    here = far_end(s)
    now = (s.radius, segments[s.left].radius, segments[s.right].radius)
    slack = node_slack(segments, room, i, here, now)
    # A joint that doesn't part is mended first of all; where it can't be it mustn't get worse.
    done = _push_to(segments, index, room, law, flow_over_drop, i, 0.0)
    if done == 0 and slack < 0.0:
        done = _push_to(segments, index, room, law, flow_over_drop, i, slack)
    return done


@jit
def _push_to(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    i: int,
    joint: float,
) -> int:
    """The same, to where the joints leave ``joint`` of room at least."""
    s = segments[i]
    here = far_end(s)
    for step in STEPS:
        least = np.inf
        best, best_radii = here, (s.radius, s.radius, s.radius)
        for n in range(len(DIRECTIONS)):
            d = DIRECTIONS[n]
            far = step * s.radius / np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
            b = (here[0] + far * d[0], here[1] + far * d[1], here[2] + far * d[2])
            cost, radii = node_value(segments, i, b, flow_over_drop, law)
            if cost < least and node_fits(index, segments, room, i, b, radii, joint):
                least, best, best_radii = cost, b, radii
        if least < np.inf:
            return 1 if commit_node(segments, index, room, law, i, best, best_radii) else 2
    return 0
