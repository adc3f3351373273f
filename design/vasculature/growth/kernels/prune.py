"""Check bifurcations, audit a grown tree for collisions and limits, and repair it."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.tissue.grid import depth_along
from design.vasculature.growth.kernels.cost import (
    drop_marked,
    place,
    refresh_upwards,
)
from design.vasculature.growth.kernels.fits import (
    end_fits,
    start_fits,
)
from design.vasculature.growth.kernels.index import (
    CellIndex,
    Clearances,
    growth_factor,
    neighbours_of,
    seven_integers,
)
from design.vasculature.growth.kernels.new_ends import move_tip, tip_near
from design.vasculature.growth.kernels.repair_settings import MUST_GO, REPAIR
from design.vasculature.options import Law
from kernels import jit


@jit
def prune(
    segments: Any, count: int, index: CellIndex, clearances: Clearances, law: Law, smallest: float
) -> int:
    """Take terminals away until no segment is wider than allowed; return the new count.

    A segment that is a little too wide loses as many of its terminals as make it thin enough, by
    Murray's law, wherever what is left can be joined straight. Where that isn't enough, or the
    segment feeds only a few, the smaller branch at its end goes (itself when it is a terminal).
    Where what is left beside it can't be joined straight, one terminal of it stays, with a tip
    that fits. Of a given trunk nothing goes. A tree pruned to its stem returns 1. The index isn't
    kept up: list anew.

    Parameters
    ----------
    smallest : float, mm
        Least radius of a moved tip; inf where no tip may be moved.
    """
    gone = np.zeros(count, np.uint8)
    wide = np.zeros(count, np.int64)
    size = 0
    for i in range(1, count):
        if segments[i].radius > segments[i].allowed:
            wide[size] = i
            size += 1
    # Small branches first: what they lose counts for those above.
    fed = np.empty(size, np.int64)
    for n in range(size):
        fed[n] = segments[wide[n]].terminals
    for n in np.argsort(fed, kind="mergesort"):
        i = wide[n]
        s = segments[i]
        if gone[i] != 0:
            continue
        goal = 0
        if s.allowed > 0.0:
            goal = int(fed[n] * (REPAIR.thinning_factor * s.allowed / s.radius) ** law.gamma)
        if s.allowed == MUST_GO:
            _take(segments, i, gone, index, clearances, law, smallest)
        elif goal < REPAIR.min_terminals or not _thin_out(
            segments, i, goal, gone, index, clearances, law
        ):
            _take(segments, _smaller_end(segments, i), gone, index, clearances, law, smallest)
        if segments[0].left < 0:
            return 1
    return drop_marked(segments, count, gone)


@jit
def _thin_out(
    segments: Any, i: int, goal: int, gone: Any, index: CellIndex, clearances: Clearances, law: Law
) -> bool:
    """Take single terminals from a branch until it feeds ``goal``; False when they don't do."""
    tips = np.empty(segments[i].terminals, np.int32)
    stack = np.empty(segments[i].terminals + 1, np.int32)
    stack[0] = i
    top = 1
    size = 0
    while top > 0:
        top -= 1
        here = stack[top]
        s = segments[here]
        if s.left < 0:
            tips[size] = here
            size += 1
        else:
            stack[top] = s.right
            stack[top + 1] = s.left
            top += 2
    if size <= goal:
        return True
    # Spread over the branch: every so many first, then those between.
    stride = max(1, size // (size - goal))
    for first in range(stride):
        for n in range(first, size, stride):
            if segments[i].terminals <= goal:
                return True
            tip = tips[n]
            parent, sibling, _, _ = neighbours_of(segments, tip)
            if gone[tip] != 0 or parent == i or segments[parent].left < 0:
                continue
            if _straight_fits(segments, index, clearances, int(parent), int(sibling), tip):
                _join(segments, int(parent), int(sibling), tip, gone, law)
    return bool(segments[i].terminals <= goal)


@jit
def _smaller_end(segments: Any, i: int) -> int:
    s = segments[i]
    if s.left < 0:
        return i
    if segments[s.left].terminals <= segments[s.right].terminals:
        return int(s.left)
    return int(s.right)


@jit
def _take(
    segments: Any,
    i: int,
    gone: Any,
    index: CellIndex,
    clearances: Clearances,
    law: Law,
    smallest: float,
) -> None:
    """Take a branch away; where no straight is left for its sibling, all but one terminal of it.

    Where that fits nowhere either, the branch above goes.
    """
    while True:
        parent, sibling, _, _ = neighbours_of(segments, i)
        if segments[i].given != 0:
            return
        stem = parent == 0 and segments[0].given == 0
        if not stem and _straight_fits(segments, index, clearances, int(parent), int(sibling), i):
            _join(segments, int(parent), int(sibling), i, gone, law)
            return
        # A single terminal with a new tip is a gain only where it was itself too wide.
        gain = segments[i].left >= 0 or segments[i].radius > segments[i].allowed
        if gain and _leave_one(segments, i, gone, index, clearances, law, smallest):
            return
        if stem:
            segments[0].left, segments[0].right = -1, -1
            return
        i = int(parent)


@jit
def _leave_one(
    segments: Any,
    i: int,
    gone: Any,
    index: CellIndex,
    clearances: Clearances,
    law: Law,
    smallest: float,
) -> bool:
    """Make a branch one terminal with a tip that fits; False when there is none."""
    one = i
    while segments[one].left >= 0:
        one = int(segments[one].left)
    flow, relative_viscosity = segments[one].flow, segments[one].relative_viscosity
    fits, t = tip_near(segments, i, index, clearances, law, flow * relative_viscosity, smallest)
    if not fits:
        return False
    _mark(segments, i, gone)
    gone[i] = 0
    s = segments[i]
    s.left, s.right, s.flow, s.relative_viscosity = -1, -1, flow, relative_viscosity
    move_tip(segments, i, index, clearances, law, t)
    return True


@jit
def _join(segments: Any, parent: int, kept: int, taken: int, gone: Any, law: Law) -> None:
    """Make ``parent`` and ``kept`` one straight segment, without the branch ``taken``."""
    up, low = segments[parent], segments[kept]
    _mark(segments, taken, gone)
    gone[kept] = 1
    place(segments, parent, (up.px, up.py, up.pz), (low.dx, low.dy, low.dz))
    up.left, up.right, up.flow = low.left, low.right, low.flow
    up.allowed = np.inf
    for child in (up.left, up.right):
        if child >= 0:
            segments[child].parent = parent
    refresh_upwards(segments, parent, law)


@jit
def _straight_fits(
    segments: Any, index: CellIndex, clearances: Clearances, parent: int, kept: int, taken: int
) -> bool:
    """Whether ``parent`` and ``kept`` can be one straight segment once ``taken`` is gone."""
    a, b = segments[parent], segments[kept]
    # A trunk's two parts are one straight already.
    if a.given != 0 and b.given != 0:
        return True
    if clearances.limits.on:
        ends = start_fits(segments, clearances.limits, parent, (b.dx, b.dy, b.dz))
        if not (ends and end_fits(segments, clearances.limits, kept, (a.px, a.py, a.pz))):
            return False
    radius = a.radius
    need = radius + clearances.wall
    if depth_along(clearances.grid, a.px, a.py, a.pz, b.dx, b.dy, b.dz, need) < need:
        return False
    above, aunt, _, _ = neighbours_of(segments, parent)
    skip = seven_integers(parent, kept, taken, above, aunt, b.left, b.right)
    free = growth_factor(
        index, segments, clearances, a.px, a.py, a.pz, b.dx, b.dy, b.dz, radius, skip, False
    )
    return bool(free >= 1.0)


@jit
def _mark(segments: Any, i: int, gone: Any) -> None:
    stack = np.empty(2 * segments[i].terminals + 2, np.int32)
    stack[0] = i
    top = 1
    while top > 0:
        top -= 1
        here = stack[top]
        gone[here] = 1
        if segments[here].left >= 0:
            stack[top] = segments[here].left
            stack[top + 1] = segments[here].right
            top += 2
