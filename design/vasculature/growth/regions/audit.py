"""Compute how wide segments of a large tree may be without collision, on several threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from design.tissue.grid import least_depth_along
from design.vasculature.growth.audit import measure_changed, too_wide
from design.vasculature.growth.clearances import Clearances, neighbours_of
from design.vasculature.growth.fit import growth_factor, seven_integers
from design.vasculature.growth.index import REACH, CellIndex
from design.vasculature.growth.joints import limit_children, limit_smaller_child
from kernels import scalar_jit

_AT_A_TIME = 50_000
"""Segments that a thread measures before it takes more."""


LARGER, SMALLER = 1.03, 0.85
"""A segment's room is measured anew once its radius is beyond these parts of what it was.

Between them the search for neighbours reached far enough: `index.REACH` times the smaller one is
above the larger one squared, with the clearance ratio of a tenth."""


def measure_again(
    segments: Any, count: int, index: CellIndex, room: Clearances, smallest: float
) -> int:
    """Derive allowed radii as `measure_in_parallel`, but only where they may be less.

    Two segments that were measured beside each other had room to grow by one factor, and their
    allowed radii are at most by that factor larger. So they fit as long as each keeps below its
    own; a segment that doesn't is measured anew, as is one whose ends moved or whose radius changed
    much.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    mark_changed(segments, count)
    measure_changed(segments, count, index, room, smallest, False)
    limit_joints(segments, count, room)
    return int(too_wide(segments, count))


@scalar_jit
def mark_changed(segments: Any, count: int) -> None:
    """Allow any radius to what must be measured anew: that is what `measure_changed` looks for."""
    for i in range(count):
        s = segments[i]
        alike = SMALLER * s.audited < s.radius < LARGER * s.audited
        if not alike or s.radius > s.allowed or s.allowed == np.inf:
            s.allowed, s.audited = np.inf, s.radius


def measure_in_parallel(
    segments: Any, count: int, index: CellIndex, room: Clearances, smallest: float, threads: int
) -> int:
    """Derive allowed radii as `growth.audit.measure_allowed_radii` with joints does.

    Every segment is measured by itself, so that the result doesn't depend on the threads.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    # Without a reserve the search for neighbours goes on to the nearest.
    alone = room._replace(reserve=0.0)

    def measure(begin: int) -> None:
        own = index._replace(stamp=np.zeros_like(index.stamp), query=np.zeros_like(index.query))
        end = min(begin + _AT_A_TIME, count)
        measure_alone(segments, begin, end, own, alone, smallest)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(measure, range(0, count, _AT_A_TIME)))
    limit_joints(segments, count, room)
    return int(too_wide(segments, count))


@scalar_jit
def measure_alone(
    segments: Any, begin: int, end: int, index: CellIndex, room: Clearances, smallest: float
) -> None:
    """Derive the allowed radii of segments ``begin`` to ``end`` from tissue and neighbours."""
    for i in range(begin, end):
        s = segments[i]
        s.allowed, s.audited = np.inf, s.radius
        if s.given != 0:
            continue
        parent, sibling, left, right = neighbours_of(segments, i)
        if i > 0:
            most = REACH * s.radius + room.wall
            depth = least_depth_along(room.grid, s.px, s.py, s.pz, s.dx, s.dy, s.dz, most, 0.0)
            s.allowed = depth - room.wall
        skip = seven_integers(i, parent, sibling, left, right, -1, -1)
        free = growth_factor(
            index, segments, room, s.px, s.py, s.pz, s.dx, s.dy, s.dz, s.radius, skip, False
        )
        s.allowed = min(s.allowed, free * s.radius)
        if left < 0 and s.radius < smallest:
            s.allowed = min(s.allowed, 0.0)


@scalar_jit
def limit_joints(segments: Any, count: int, room: Clearances) -> None:
    """Lower the allowed radii of children that don't part, as `growth.audit` does."""
    for i in range(count):
        _, _, left, right = neighbours_of(segments, i)
        if right >= 0:
            limit_children(segments, room, left, right, segments[i])
            limit_smaller_child(segments, room, i)
