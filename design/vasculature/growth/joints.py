"""Check that vessels sharing a node diverge; limit the radii of those that don't."""

from __future__ import annotations

from typing import Any

from design.geometry import point_segment
from design.vasculature.growth.bifurcation import distance
from design.vasculature.growth.clearances import (
    Clearances,
    TrialBifurcation,
    kept_apart,
    neighbours_of,
)
from design.vasculature.growth.joint_limits import fork_within_limits, joint_within_limits
from kernels import scalar_jit

GOES = -1.0
"""Allowed radius of a branch that must go as a whole."""


@scalar_jit
def ends_clear(
    room: Clearances, tip: Any, radius: float, begin: Any, end: Any, other: float
) -> bool:
    """Whether a vessel's end keeps clear of a vessel that it shares its other node with.

    With the room's reserve on both radii, for they go on growing: joints that just parted when
    they were made cost a forest of 10,000 terminals a ninth of one tree at its audit.

    Parameters
    ----------
    tip : (float, float, float), mm
        The end away from the joint of a vessel of ``radius``.
    begin, end : (float, float, float), mm
        The other vessel, of radius ``other``.
    """
    away, _ = point_segment(
        tip[0], tip[1], tip[2], begin[0], begin[1], begin[2], end[0], end[1], end[2]
    )
    return bool(away >= room.reserve * (radius + other) + kept_apart(room, radius, other))


@scalar_jit
def joint_fits(segments: Any, room: Clearances, fork: TrialBifurcation) -> bool:
    """Whether a fork's three pieces are long enough, and part from each other and at their ends."""
    s = segments[fork.segment]
    p, d = (s.px, s.py, s.pz), (s.dx, s.dy, s.dz)
    b, t = (fork.bx, fork.by, fork.bz), (fork.tx, fork.ty, fork.tz)
    k = room.length_to_radius
    if distance(p[0], p[1], p[2], b[0], b[1], b[2]) < k * fork.up:
        return False
    if distance(b[0], b[1], b[2], d[0], d[1], d[2]) < k * fork.low:
        return False
    if distance(b[0], b[1], b[2], t[0], t[1], t[2]) < k * fork.new:
        return False
    if not ends_clear(room, t, fork.new, b, d, fork.low):
        return False
    if not ends_clear(room, d, fork.low, b, t, fork.new):
        return False
    if not ends_clear(room, t, fork.new, p, b, fork.up):
        return False
    if not ends_clear(room, d, fork.low, p, b, fork.up):
        return False
    if s.given == 0 and not _still_parted(segments, room, fork, p, b, d):
        return False
    return not room.limits.on or fork_within_limits(segments, room.limits, fork)


@scalar_jit
def _still_parted(
    segments: Any, room: Clearances, fork: TrialBifurcation, p: Any, b: Any, d: Any
) -> bool:
    """Whether the joints at either end of the parted segment bear the pieces it leaves there."""
    parent, sibling, left, right = neighbours_of(segments, fork.segment)
    if parent >= 0:
        o = segments[parent]
        begin, end = (o.px, o.py, o.pz), (o.dx, o.dy, o.dz)
        if not ends_clear(room, b, fork.up, begin, end, o.radius):
            return False
    if sibling >= 0:
        o = segments[sibling]
        begin, end = (o.px, o.py, o.pz), (o.dx, o.dy, o.dz)
        if not ends_clear(room, b, fork.up, begin, end, o.radius):
            return False
        if not ends_clear(room, end, o.radius, p, b, fork.up):
            return False
    for child in (left, right):
        if child >= 0:
            o = segments[child]
            if not ends_clear(room, (o.dx, o.dy, o.dz), o.radius, b, d, fork.low):
                return False
    return True


@scalar_jit
def limit_smaller_child(segments: Any, room: Clearances, i: int) -> None:
    """Allow the smaller child of a joint that breaks the room's limits nothing: it must go."""
    if not room.limits.on or joint_within_limits(segments, room.limits, i):
        return
    one, two = segments[segments[i].left], segments[segments[i].right]
    if one.given != 0 and two.given != 0:
        return
    small = one
    if one.given != 0 or (two.flow < one.flow and two.given == 0):
        small = two
    small.allowed = GOES


@scalar_jit
def limit_children(segments: Any, room: Clearances, left: Any, right: Any, parent: Any) -> None:
    """Lower the ``allowed`` radii of a segment's children to where they still part.

    Each must end clear of its sibling and its parent, and be long enough for its radius. Where
    siblings don't part the thinner is held to blame: to take it costs fewest terminals. A given
    trunk's segment never is.
    """
    one, two = segments[left], segments[right]
    thin, wide = one, two
    if one.given != 0 or (two.radius < one.radius and two.given == 0):
        thin, wide = two, one
    for tip, other in ((one, two), (two, one)):
        thin.allowed = min(
            thin.allowed, largest_radius_beside(room, away_from(tip, other), wide.radius)
        )
    for child in (left, right):
        c = segments[child]
        c.allowed = min(c.allowed, largest_radius_beside(room, away_from(c, parent), parent.radius))
        if room.length_to_radius > 0.0:
            c.allowed = min(c.allowed, c.length / room.length_to_radius)


@scalar_jit
def away_from(tip: Any, other: Any) -> float:
    """Distance of a vessel's far end from another's axis, mm."""
    o = other
    away, _ = point_segment(tip.dx, tip.dy, tip.dz, o.px, o.py, o.pz, o.dx, o.dy, o.dz)
    return away


@scalar_jit
def largest_radius_beside(room: Clearances, away: float, other: float) -> float:
    """Largest radius of a vessel ``away`` from another of radius ``other``, all in mm."""
    free = away - other
    # The kept distance goes by the thinner of the two, whichever that comes out to be.
    kept = max(free / (1.0 + room.ratio), free - room.ratio * other)
    return max(0.0, min(free - room.clearance, kept))
