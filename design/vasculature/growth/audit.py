"""Compute how wide each segment of a grown tree may be without collision; count those too wide."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.tissue.grid import least_depth_along
from design.vasculature.growth.clearances import Clearances, neighbours_of, widest_of
from design.vasculature.growth.fit import growth_factor, seven_integers
from design.vasculature.growth.index import REACH, CellIndex
from design.vasculature.growth.joints import limit_children, limit_smaller_child
from kernels import jit


@jit
def measure_allowed_radii(
    segments: Any, count: int, index: CellIndex, room: Clearances, smallest: float, joints: bool
) -> int:
    """Derive every segment's allowed radius from tissue and neighbours.

    The index must list all segments with their present radii. A terminal thinner than
    ``smallest`` is allowed no radius at all, nor is the smaller branch of a joint that breaks the
    room's limits. A given trunk's segments are allowed any: whoever meets them must go.

    Parameters
    ----------
    joints : bool
        Whether joints limit radii too: at the end alone, for a branch that its joint held back
        while the tree grows would be closed to all that has yet to join it.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    for i in range(count):
        segments[i].allowed = np.inf
    measure_changed(segments, count, index, room, smallest, joints)
    return too_wide(segments, count)


@jit
def measure_changed(
    segments: Any, count: int, index: CellIndex, room: Clearances, smallest: float, joints: bool
) -> None:
    """Derive allowed radii as `measure_allowed_radii`, where a segment's own is inf."""
    changed = np.zeros(count, np.bool_)
    for i in range(count):
        changed[i] = segments[i].allowed == np.inf
    for i in range(count):
        s = segments[i]
        parent, sibling, left, right = neighbours_of(segments, i)
        if joints and right >= 0 and (changed[i] or changed[left] or changed[right]):
            limit_children(segments, room, left, right, s)
            limit_smaller_child(segments, room, i)
        # What comes near a given trunk finds it itself.
        if not changed[i] or s.given != 0:
            continue
        if i > 0:
            most = REACH * s.radius + room.wall
            depth = least_depth_along(room.grid, s.px, s.py, s.pz, s.dx, s.dy, s.dz, most, 0.0)
            s.allowed = min(s.allowed, depth - room.wall)
        skip = seven_integers(i, parent, sibling, left, right, -1, -1)
        free = growth_factor(
            index, segments, room, s.px, s.py, s.pz, s.dx, s.dy, s.dz, s.radius, skip, True
        )
        s.allowed = min(s.allowed, free * s.radius, widest_of(segments, room, i))
        if left < 0 and s.radius < smallest:
            s.allowed = min(s.allowed, 0.0)
    for i in range(count):
        if segments[i].given != 0:
            segments[i].allowed = widest_of(segments, room, i)


@jit
def too_wide(segments: Any, count: int) -> int:
    """How many segments are wider than allowed."""
    bad = 0
    for i in range(count):
        bad += segments[i].radius > segments[i].allowed
    return bad
