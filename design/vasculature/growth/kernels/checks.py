"""Check bifurcations, audit a grown tree for collisions and limits, and repair it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from design.geometry import point_segment
from design.tissue.grid import depth_along, least_depth_along
from design.vasculature.growth.kernels.cost import (
    TrialBifurcation,
    distance,
    drop_marked,
    from_gamma,
    place,
    refresh,
    refresh_upwards,
    to_gamma,
)
from design.vasculature.growth.kernels.index import (
    REACH,
    CellIndex,
    Clearances,
    clearance_between,
    growth_factor,
    in_tissue,
    insert,
    neighbours_of,
    seven_integers,
    widest_of,
)
from design.vasculature.options import Law, Limits, angles_fit, shares_fit
from kernels import jit, scalar_jit

MUST_GO = -1.0
"""Allowed radius of a branch that must go as a whole."""
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


class RepairSettings(NamedTuple):
    """How branches that don't fit are thinned out, and their tips moved."""

    thinning_factor: float = 0.98
    """Part of the allowed radius that a segment is thinned out to: regrowth widens other
    paths."""
    min_terminals: int = 4
    """Left by thinning out; a branch with fewer is taken away."""
    tip_directions: int = 48
    """Tried for a new tip, spread over the sphere."""
    tip_lengths: tuple[float, float, float] = (1.0, 0.7, 0.4)
    """Tried in each direction, over the branch's length."""


REPAIR = RepairSettings()


# Check that a trial bifurcation fits: in the tissue, between neighbours, as a joint.


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


# Remove terminals from a tree until no segment is wider than its surroundings allow.


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


# Compute how wide each segment of a grown tree may be without collision; count those too wide.


@jit
def measure_allowed_radii(
    segments: Any,
    count: int,
    index: CellIndex,
    clearances: Clearances,
    smallest: float,
    joints: bool,
) -> int:
    """Derive every segment's allowed radius from tissue and neighbours.

    The index must list all segments with their present radii. A terminal thinner than
    ``smallest`` is allowed no radius at all, nor is the smaller branch of a joint that breaks the
    limits. A given trunk's segments are allowed any: whoever meets them must go.

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
    measure_changed(segments, count, index, clearances, smallest, joints)
    return too_wide(segments, count)


@scalar_jit
def allowed_radius(
    segments: Any, i: Any, index: CellIndex, clearances: Clearances, record: bool
) -> float:
    """Largest radius that the tissue and the neighbours leave to segment ``i``, mm.

    With ``record`` the neighbours' ``allowed`` radii are lowered too.
    """
    s = segments[i]
    depth = np.inf
    # The stem enters through the surface.
    if i > 0:
        most = REACH * s.radius + clearances.wall
        depth = least_depth_along(clearances.grid, s.px, s.py, s.pz, s.dx, s.dy, s.dz, most, 0.0)
    parent, sibling, left, right = neighbours_of(segments, i)
    skip = seven_integers(i, parent, sibling, left, right, -1, -1)
    free = growth_factor(
        index, segments, clearances, s.px, s.py, s.pz, s.dx, s.dy, s.dz, s.radius, skip, record
    )
    return min(depth - clearances.wall, free * s.radius, widest_of(segments, clearances, i))


@jit
def measure_changed(
    segments: Any,
    count: int,
    index: CellIndex,
    clearances: Clearances,
    smallest: float,
    joints: bool,
) -> None:
    """Derive allowed radii as `measure_allowed_radii`, where a segment's own is inf."""
    changed = np.zeros(count, np.bool_)
    for i in range(count):
        changed[i] = segments[i].allowed == np.inf
    for i in range(count):
        s = segments[i]
        _, _, left, right = neighbours_of(segments, i)
        if joints and right >= 0 and (changed[i] or changed[left] or changed[right]):
            limit_children(segments, clearances, left, right, s)
            limit_smaller_child(segments, clearances, i)
        # What comes near a given trunk finds it itself.
        if not changed[i] or s.given != 0:
            continue
        s.allowed = min(s.allowed, allowed_radius(segments, i, index, clearances, True))
        if left < 0 and s.radius < smallest:
            s.allowed = min(s.allowed, 0.0)
    for i in range(count):
        if segments[i].given != 0:
            segments[i].allowed = widest_of(segments, clearances, i)


@jit
def too_wide(segments: Any, count: int) -> int:
    """How many segments are wider than allowed."""
    bad = 0
    for i in range(count):
        bad += segments[i].radius > segments[i].allowed
    return bad


# Find a new end point for a terminal that has no place, or that is left of a pruned branch.


@jit
def tip_near(
    segments: Any,
    i: int,
    index: CellIndex,
    clearances: Clearances,
    law: Law,
    weight: float,
    least: float,
) -> tuple[bool, tuple[float, float, float]]:
    """A tip that fits for branch ``i``, were it a terminal of flow times viscosity ``weight``.

    Its own way comes first, then ways all around its start; of each the long ones.

    Parameters
    ----------
    least : float, mm
        Smallest radius of the terminal.
    """
    s = segments[i]
    _, sibling, _, _ = neighbours_of(segments, i)
    p = (s.px, s.py, s.pz)
    if sibling < 0 or clearances.limits.on:
        return False, p
    ways = np.empty((REPAIR.tip_directions + 1, 3))
    ways[0] = ((s.dx - s.px) / s.length, (s.dy - s.py) / s.length, (s.dz - s.pz) / s.length)
    for n in range(REPAIR.tip_directions):
        up = 1.0 - (2 * n + 1) / REPAIR.tip_directions
        flat, turn = np.sqrt(1.0 - up * up), GOLDEN_ANGLE * n
        ways[n + 1] = (flat * np.cos(turn), flat * np.sin(turn), up)
    for part in REPAIR.tip_lengths:
        length = part * s.length
        radius = _tip_radius(segments, i, weight, length, law)
        if radius < least or length < clearances.length_to_radius * radius:
            continue
        for way in ways:
            t = (p[0] + length * way[0], p[1] + length * way[1], p[2] + length * way[2])
            if _tip_fits(segments, i, index, clearances, t, radius):
                return True, t
    return False, p


@jit
def retip_thin(
    segments: Any,
    count: int,
    index: CellIndex,
    clearances: Clearances,
    law: Law,
    points: Any,
    least: float,
) -> None:
    """Move each terminal whose allowed radius is 0 to one of ``points`` that makes it wide enough.

    Of the points that fit and give a radius of at least ``least`` (mm) the nearest is taken;
    where there is none, the terminal stays as it is.
    """
    for i in range(1, count):
        if segments[i].left < 0 and segments[i].allowed == 0.0 and segments[i].given == 0:
            best = _nearest_tip(segments, i, index, clearances, law, points, least)
            if best >= 0:
                move_tip(segments, i, index, clearances, law, points[best])


@jit
def _nearest_tip(
    segments: Any,
    i: int,
    index: CellIndex,
    clearances: Clearances,
    law: Law,
    points: Any,
    least: float,
) -> int:
    s = segments[i]
    shortest, best = np.inf, -1
    weight = s.flow * s.relative_viscosity
    for n in range(len(points)):
        t = points[n]
        length = distance(s.px, s.py, s.pz, t[0], t[1], t[2])
        if length >= shortest:
            continue
        radius = _tip_radius(segments, i, weight, length, law)
        if radius < least or length < clearances.length_to_radius * radius:
            continue
        if _tip_fits(segments, i, index, clearances, t, radius):
            shortest = length
            best = n
    return best


@jit
def _tip_radius(segments: Any, i: int, weight: float, length: float, law: Law) -> float:
    """Radius that a terminal of this flow times viscosity and length has beside its sibling."""
    parent, sibling, _, _ = neighbours_of(segments, i)
    resistance = weight * law.k * length
    m = from_gamma(
        to_gamma(resistance, law) + to_gamma(segments[sibling].weighted_resistance, law), law
    )
    return float(segments[parent].radius * np.sqrt(np.sqrt(resistance / m)))


@jit
def _tip_fits(
    segments: Any, i: int, index: CellIndex, clearances: Clearances, t: Any, radius: float
) -> bool:
    s = segments[i]
    parent, sibling, _, _ = neighbours_of(segments, i)
    for n in (parent, sibling):
        o = segments[n]
        gap = radius + o.radius + clearance_between(clearances, radius, o.radius)
        away, _ = point_segment(t[0], t[1], t[2], o.px, o.py, o.pz, o.dx, o.dy, o.dz)
        if away < gap:
            return False
    o = segments[sibling]
    gap = radius + o.radius + clearance_between(clearances, radius, o.radius)
    away, _ = point_segment(o.dx, o.dy, o.dz, s.px, s.py, s.pz, t[0], t[1], t[2])
    if away < gap:
        return False
    if clearances.limits.on and not start_fits(segments, clearances.limits, i, (t[0], t[1], t[2])):
        return False
    if not in_tissue(clearances, s.px, s.py, s.pz, t[0], t[1], t[2], radius):
        return False
    skip = seven_integers(i, parent, sibling, -1, -1, -1, -1)
    free = growth_factor(
        index, segments, clearances, s.px, s.py, s.pz, t[0], t[1], t[2], radius, skip, False
    )
    return bool(free >= clearances.reserve)


@jit
def move_tip(
    segments: Any, i: int, index: CellIndex, clearances: Clearances, law: Law, t: Any
) -> None:
    """Put a terminal's tip elsewhere, and list it there besides."""
    s = segments[i]
    place(segments, i, (s.px, s.py, s.pz), (t[0], t[1], t[2]))
    s.radius = _tip_radius(segments, i, s.flow * s.relative_viscosity, s.length, law)
    s.allowed = np.inf
    refresh(segments, i, law)
    refresh_upwards(segments, s.parent, law)
    # Where the index is full the audit that follows still sees what meets the new tip.
    insert(index, i, s, REACH * s.radius + clearances.clearance)


@scalar_jit
def limit_joints(segments: Any, count: int, clearances: Clearances) -> None:
    """Lower the allowed radii of children that don't part, as `growth.checks` does."""
    for i in range(count):
        _, _, left, right = neighbours_of(segments, i)
        if right >= 0:
            limit_children(segments, clearances, left, right, segments[i])
            limit_smaller_child(segments, clearances, i)
