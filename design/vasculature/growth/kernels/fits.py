"""Check that a trial bifurcation fits: in the tissue, between neighbours, as a joint."""

from __future__ import annotations

from typing import Any

from design.geometry import point_segment
from design.vasculature.growth.kernels.bifurcation import TrialBifurcation, distance
from design.vasculature.growth.kernels.index import (
    CellIndex,
    Clearances,
    clearance_between,
    growth_factor,
    in_tissue,
    neighbours_of,
    seven_integers,
)
from design.vasculature.growth.kernels.repair_settings import MUST_GO
from design.vasculature.options import Limits, angles_fit, shares_fit
from kernels import scalar_jit


@scalar_jit
def fits(index: CellIndex, segments: Any, clearances: Clearances, fork: TrialBifurcation) -> bool:
    """Whether a fork fits everywhere; the cheap tests first."""
    if not joint_fits(segments, clearances, fork):
        return False
    s = segments[fork.segment]
    bx, by, bz = fork.bx, fork.by, fork.bz
    tx, ty, tz = fork.tx, fork.ty, fork.tz
    if not in_tissue(clearances, bx, by, bz, tx, ty, tz, fork.new):
        return False
    i = fork.segment
    # A trunk's segment stays where it is; whoever meets it wider must go, as the audit will find.
    if s.given == 0 and not in_tissue(clearances, s.px, s.py, s.pz, bx, by, bz, fork.up):
        return False
    if s.given == 0 and not in_tissue(clearances, bx, by, bz, s.dx, s.dy, s.dz, fork.low):
        return False
    parent, sibling, left, right = neighbours_of(segments, i)
    skip = seven_integers(i, -1, -1, -1, -1, -1, -1)
    if (
        growth_factor(index, segments, clearances, bx, by, bz, tx, ty, tz, fork.new, skip, False)
        < clearances.reserve
    ):
        return False
    if s.given != 0:
        return True
    skip = seven_integers(i, parent, sibling, -1, -1, -1, -1)
    if (
        growth_factor(
            index, segments, clearances, s.px, s.py, s.pz, bx, by, bz, fork.up, skip, False
        )
        < clearances.reserve
    ):
        return False
    skip = seven_integers(i, left, right, -1, -1, -1, -1)
    return bool(
        growth_factor(
            index, segments, clearances, bx, by, bz, s.dx, s.dy, s.dz, fork.low, skip, False
        )
        >= clearances.reserve
    )


@scalar_jit
def flows_fit(segments: Any, limits: Limits, i: Any, flow: float) -> bool:
    """Whether a fork on segment ``i`` for a branch of ``flow`` parts the flow as it must.

    On the way to the root no joint may be pushed out of the limits, or further out.
    """
    if limits.share <= 0.0:
        return True
    if not shares_fit(limits, segments[i].flow, flow):
        return False
    here = i
    while segments[here].parent >= 0:
        _, sibling, _, _ = neighbours_of(segments, here)
        if sibling >= 0:
            mine, other = segments[here].flow + flow, segments[sibling].flow
            fixed = segments[here].given != 0 and segments[sibling].given != 0
            if not fixed and mine > other and not shares_fit(limits, mine, other):
                return False
        here = segments[here].parent
    return True


@scalar_jit
def fork_within_limits(segments: Any, limits: Limits, fork: Any) -> bool:
    """Whether a fork's joint, and those at either end of the parted segment, keep the limits."""
    i = int(fork.segment)
    s = segments[i]
    p, d = (s.px, s.py, s.pz), (s.dx, s.dy, s.dz)
    b, t = (fork.bx, fork.by, fork.bz), (fork.tx, fork.ty, fork.tz)
    if not angles_fit(limits, p, b, d, t):
        return False
    # The parts of a trunk's segment go on as it did.
    if s.given == 0 and not (
        start_fits(segments, limits, i, b) and end_fits(segments, limits, i, b)
    ):
        return False
    return flows_fit(segments, limits, i, fork.flow)


@scalar_jit
def start_fits(segments: Any, limits: Limits, i: Any, end: Any) -> bool:
    """Whether the joint at the near end of segment ``i`` keeps the limits if it ends at ``end``."""
    parent, sibling, _, _ = neighbours_of(segments, i)
    if parent < 0 or sibling < 0:
        return True
    up, s, o = segments[parent], segments[i], segments[sibling]
    return angles_fit(limits, (up.px, up.py, up.pz), (s.px, s.py, s.pz), end, (o.dx, o.dy, o.dz))


@scalar_jit
def end_fits(segments: Any, limits: Limits, i: Any, begin: Any) -> bool:
    """Whether the joint at its far end keeps the limits if segment ``i`` begins at ``begin``."""
    s = segments[i]
    if s.left < 0 or s.right < 0:
        return True
    a, b = segments[s.left], segments[s.right]
    return angles_fit(limits, begin, (s.dx, s.dy, s.dz), (a.dx, a.dy, a.dz), (b.dx, b.dy, b.dz))


@scalar_jit
def joint_within_limits(segments: Any, limits: Limits, i: Any) -> bool:
    """Whether the joint at the far end of segment ``i`` keeps all limits."""
    s = segments[i]
    if s.left < 0 or s.right < 0:
        return True
    if not end_fits(segments, limits, i, (s.px, s.py, s.pz)):
        return False
    return shares_fit(limits, segments[s.left].flow, segments[s.right].flow)


@scalar_jit
def ends_clear(
    clearances: Clearances, tip: Any, radius: float, begin: Any, end: Any, other: float
) -> bool:
    """Whether a vessel's end keeps clear of a vessel that it shares its other node with.

    With the reserve of ``clearances`` on both radii, for they go on growing: joints that just
    parted when they were made cost a forest of 10,000 terminals a ninth of one tree at its audit.

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
    return bool(
        away >= clearances.reserve * (radius + other) + clearance_between(clearances, radius, other)
    )


@scalar_jit
def joint_fits(segments: Any, clearances: Clearances, fork: TrialBifurcation) -> bool:
    """Whether a fork's three pieces are long enough, and part from each other and at their ends."""
    s = segments[fork.segment]
    p, d = (s.px, s.py, s.pz), (s.dx, s.dy, s.dz)
    b, t = (fork.bx, fork.by, fork.bz), (fork.tx, fork.ty, fork.tz)
    k = clearances.length_to_radius
    if distance(p[0], p[1], p[2], b[0], b[1], b[2]) < k * fork.up:
        return False
    if distance(b[0], b[1], b[2], d[0], d[1], d[2]) < k * fork.low:
        return False
    if distance(b[0], b[1], b[2], t[0], t[1], t[2]) < k * fork.new:
        return False
    if not ends_clear(clearances, t, fork.new, b, d, fork.low):
        return False
    if not ends_clear(clearances, d, fork.low, b, t, fork.new):
        return False
    if not ends_clear(clearances, t, fork.new, p, b, fork.up):
        return False
    if not ends_clear(clearances, d, fork.low, p, b, fork.up):
        return False
    if s.given == 0 and not _still_parted(segments, clearances, fork, p, b, d):
        return False
    return not clearances.limits.on or fork_within_limits(segments, clearances.limits, fork)


@scalar_jit
def _still_parted(
    segments: Any, clearances: Clearances, fork: TrialBifurcation, p: Any, b: Any, d: Any
) -> bool:
    """Whether the joints at either end of the parted segment bear the pieces it leaves there."""
    parent, sibling, left, right = neighbours_of(segments, fork.segment)
    if parent >= 0:
        o = segments[parent]
        begin, end = (o.px, o.py, o.pz), (o.dx, o.dy, o.dz)
        if not ends_clear(clearances, b, fork.up, begin, end, o.radius):
            return False
    if sibling >= 0:
        o = segments[sibling]
        begin, end = (o.px, o.py, o.pz), (o.dx, o.dy, o.dz)
        if not ends_clear(clearances, b, fork.up, begin, end, o.radius):
            return False
        if not ends_clear(clearances, end, o.radius, p, b, fork.up):
            return False
    for child in (left, right):
        if child >= 0:
            o = segments[child]
            if not ends_clear(clearances, (o.dx, o.dy, o.dz), o.radius, b, d, fork.low):
                return False
    return True


@scalar_jit
def limit_smaller_child(segments: Any, clearances: Clearances, i: int) -> None:
    """Allow the smaller child of a joint that breaks the limits nothing: it must go."""
    if not clearances.limits.on or joint_within_limits(segments, clearances.limits, i):
        return
    one, two = segments[segments[i].left], segments[segments[i].right]
    if one.given != 0 and two.given != 0:
        return
    small = one
    if one.given != 0 or (two.flow < one.flow and two.given == 0):
        small = two
    small.allowed = MUST_GO


@scalar_jit
def limit_children(
    segments: Any, clearances: Clearances, left: Any, right: Any, parent: Any
) -> None:
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
            thin.allowed, largest_radius_beside(clearances, away_from(tip, other), wide.radius)
        )
    for child in (left, right):
        c = segments[child]
        c.allowed = min(
            c.allowed, largest_radius_beside(clearances, away_from(c, parent), parent.radius)
        )
        if clearances.length_to_radius > 0.0:
            c.allowed = min(c.allowed, c.length / clearances.length_to_radius)


@scalar_jit
def away_from(tip: Any, other: Any) -> float:
    """Distance of a vessel's far end from another's axis, mm."""
    o = other
    away, _ = point_segment(tip.dx, tip.dy, tip.dz, o.px, o.py, o.pz, o.dx, o.dy, o.dz)
    return away


@scalar_jit
def largest_radius_beside(clearances: Clearances, away: float, other: float) -> float:
    """Largest radius of a vessel ``away`` from another of radius ``other``, all in mm."""
    free = away - other
    # The kept distance goes by the thinner of the two, whichever that comes out to be.
    kept = max(free / (1.0 + clearances.ratio), free - clearances.ratio * other)
    return max(0.0, min(free - clearances.clearance, kept))
