"""Check that a trial bifurcation fits: in the tissue, between neighbours, as a joint."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from design.geometry import point_segment, segment_segment
from design.tissue.grid import depth_along
from design.vasculature.growth.cost import Sprout, from_gamma, to_gamma, to_lambda
from design.vasculature.growth.index import (
    REACH,
    CellIndex,
    Clearances,
    TrialBifurcation,
    cell_range,
    kept_apart,
    neighbours_of,
)
from design.vasculature.options import Law, Limits
from kernels import jit, scalar_jit

LEAVES = 1.5
"""Way along a branch, over its radius and its trunk's, within which it is still leaving that."""
Seven = tuple[np.int64, np.int64, np.int64, np.int64, np.int64, np.int64, np.int64]


@jit
def seven_integers(a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any) -> Seven:
    """Make a tuple of equal integers, whatever their widths."""
    wide = np.int64
    return (wide(a), wide(b), wide(c), wide(d), wide(e), wide(f), wide(g))


@scalar_jit
def pair_growth_factor(room: Clearances, away: float, one: float, two: float) -> float:
    """Factor by which vessels ``away`` (mm) from each other could both widen until they collide."""
    both = one + two
    factor = away / (both + room.ratio * min(one, two))
    if room.clearance > 0.0:
        # The fixed part of the clearance doesn't grow with the radii.
        factor = min(factor, (away - room.clearance) / both)
    return factor


@scalar_jit
def away_from_trunk(
    s: Any,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    radius: float,
    away: float,
) -> float:
    """Distance of a branch from a trunk's segment; where it begins in its lumen, once outside.

    A trunk's pieces may be shorter than it is wide, so that a branch of one begins within the
    next. ``away`` is the distance of the axes.
    """
    inner, _ = point_segment(ax, ay, az, s.px, s.py, s.pz, s.dx, s.dy, s.dz)
    if inner >= s.radius:
        return away
    x, y, z = bx - ax, by - ay, bz - az
    part = LEAVES * (s.radius + radius) / max(1e-12, np.sqrt(x * x + y * y + z * z))
    if part >= 1.0:
        return np.inf
    x, y, z = ax + part * x, ay + part * y, az + part * z
    return float(segment_segment(x, y, z, bx, by, bz, s.px, s.py, s.pz, s.dx, s.dy, s.dz)[0])


@scalar_jit
def growth_factor(
    index: CellIndex,
    segments: Any,
    room: Clearances,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    radius: float,
    skip: Seven,
    record: bool,
) -> float:
    """How far a capsule and its neighbours could grow, all by one factor, before they collide.

    Parameters
    ----------
    skip : seven int
        Segments left out (itself, and those that share a node with it), or -1.
    record : bool
        Lower the neighbours' ``allowed`` radii to that factor.

    Returns
    -------
    float
        Below 1 when there is a collision; at most `REACH`. Without ``record`` the search ends
        below the room's reserve.
    """
    least = REACH
    reach = REACH * radius
    index.query[0] += 1
    query = index.query[0]
    for i in skip:
        if i >= 0:
            index.stamp[i] = query
    i0, i1 = cell_range(index, 0, min(ax, bx) - reach, max(ax, bx) + reach)
    j0, j1 = cell_range(index, 1, min(ay, by) - reach, max(ay, by) + reach)
    k0, k1 = cell_range(index, 2, min(az, bz) - reach, max(az, bz) + reach)
    far = reach + 0.8660254037844386 * index.cell
    several = i1 > i0 or j1 > j0 or k1 > k0
    for a in range(i0, i1 + 1):
        x = index.origin[0] + (a + 0.5) * index.cell
        for b in range(j0, j1 + 1):
            y = index.origin[1] + (b + 0.5) * index.cell
            for c in range(k0, k1 + 1):
                entry = index.head[(a * index.shape[1] + b) * index.shape[2] + c]
                if entry < 0:
                    continue
                if several:
                    z = index.origin[2] + (c + 0.5) * index.cell
                    if point_segment(x, y, z, ax, ay, az, bx, by, bz)[0] > far:
                        continue
                while entry >= 0:
                    i = index.item[entry]
                    entry = index.following[entry]
                    if index.stamp[i] == query:
                        continue
                    index.stamp[i] = query
                    s = segments[i]
                    d, _, _ = segment_segment(
                        ax, ay, az, bx, by, bz, s.px, s.py, s.pz, s.dx, s.dy, s.dz
                    )
                    if s.given != 0:
                        d = away_from_trunk(s, ax, ay, az, bx, by, bz, radius, d)
                    factor = pair_growth_factor(room, d, radius, s.radius)
                    if factor < least:
                        least = factor
                        if least < room.reserve and not record:
                            return least
                    if record and factor * s.radius < s.allowed:
                        s.allowed = factor * s.radius
    return least


@scalar_jit
def in_tissue(
    room: Clearances,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    radius: float,
) -> bool:
    """Whether a capsule keeps its distance from the tissue's surface."""
    need = room.reserve * radius + room.wall
    return bool(depth_along(room.grid, ax, ay, az, bx, by, bz, need) >= need)


@scalar_jit
def fits(index: CellIndex, segments: Any, room: Clearances, fork: TrialBifurcation) -> bool:
    """Whether a fork fits everywhere; the cheap tests first."""
    if not joint_fits(segments, room, fork):
        return False
    s = segments[fork.segment]
    bx, by, bz = fork.bx, fork.by, fork.bz
    tx, ty, tz = fork.tx, fork.ty, fork.tz
    if not in_tissue(room, bx, by, bz, tx, ty, tz, fork.new):
        return False
    i = fork.segment
    # A trunk's segment stays where it is; whoever meets it wider must go, as the audit will find.
    if s.given == 0 and not in_tissue(room, s.px, s.py, s.pz, bx, by, bz, fork.up):
        return False
    if s.given == 0 and not in_tissue(room, bx, by, bz, s.dx, s.dy, s.dz, fork.low):
        return False
    parent, sibling, left, right = neighbours_of(segments, i)
    skip = seven_integers(i, -1, -1, -1, -1, -1, -1)
    if (
        growth_factor(index, segments, room, bx, by, bz, tx, ty, tz, fork.new, skip, False)
        < room.reserve
    ):
        return False
    if s.given != 0:
        return True
    skip = seven_integers(i, parent, sibling, -1, -1, -1, -1)
    if (
        growth_factor(index, segments, room, s.px, s.py, s.pz, bx, by, bz, fork.up, skip, False)
        < room.reserve
    ):
        return False
    skip = seven_integers(i, left, right, -1, -1, -1, -1)
    return bool(
        growth_factor(index, segments, room, bx, by, bz, s.dx, s.dy, s.dz, fork.low, skip, False)
        >= room.reserve
    )


# Check bifurcations against limits on branching angles and flow split.

_ROUNDING = 1e-12


@jit
def _cosine(at: Any, a: Any, b: Any) -> float:
    """Cosine of the angle at one point between the ways to two others; 1 where there is none."""
    ux, uy, uz = a[0] - at[0], a[1] - at[1], a[2] - at[2]
    vx, vy, vz = b[0] - at[0], b[1] - at[1], b[2] - at[2]
    size = sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz))
    if not size > 0.0:
        return 1.0
    return (ux * vx + uy * vy + uz * vz) / size


@jit
def angles_fit(limits: Limits, begin: Any, at: Any, one: Any, two: Any) -> bool:
    """Whether a joint at ``at`` keeps the limits on angles.

    Parameters
    ----------
    begin : (float, float, float), mm
        Where the parent comes from.
    one, two : (float, float, float), mm
        Ends of the children.
    """
    c = _cosine(at, one, two)
    if c > limits.narrow + _ROUNDING or c < limits.wide - _ROUNDING:
        return False
    for end in (one, two):
        c = -_cosine(at, begin, end)
        if c > limits.slight + _ROUNDING or c < limits.sharp - _ROUNDING:
            return False
    return True


@jit
def shares_fit(limits: Limits, one: float, two: float) -> bool:
    """Whether two children's flows are near enough to each other."""
    return bool(min(one, two) >= (limits.share - _ROUNDING) * max(one, two))


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


# Check that vessels sharing a node diverge; limit the radii of those that don't.

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


# Find the least-cost branch point on a segment for a new terminal, by a linear cost model.


@jit
def split_value(
    s: Any, up: float, low: float, new: float, sprout: Sprout, law: Law
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Load and spend above a bifurcation that parts segment ``s``, and their derivatives.

    Parameters
    ----------
    s : record
        The segment as it is.
    up, low, new : float, mm
        Lengths from its start to the bifurcation, on to its end, and to the new terminal.
    sprout : Sprout
        The new terminal's flow and viscosity.

    Returns
    -------
    load, spend : float
        Of the upper part, over the lower part and the new terminal.
    load_by_up, load_by_low, load_by_new, spend_by_up, spend_by_low, spend_by_new : float
    low_load, m : float
        Load of the lower part; joint load of it and the new terminal.
    """
    e = 0.25 * law.lam
    n, above, own = s.flow, s.flow + sprout.flow, sprout.flow
    if law.haematocrit >= 0.0:
        n, above, own = n * s.thick, above * s.thick, own * sprout.thick
    # Both cases here in one: LLVM would work out the powers of `to_u` in any case, to choose then.
    if law.u == 1.0:
        u_old, u_up, u_low, u_new = s.length, up, low, new
        slope_up, slope_low, slope_new = 1.0, 1.0, 1.0
    else:
        u_old, u_up, u_low, u_new = s.length**law.u, up**law.u, low**law.u, new**law.u
        slope_up, slope_low, slope_new = law.u * u_up / up, law.u * u_low / low, law.u * u_new / new
    # C* of the lower part: the old one with the length exchanged.
    reduced = s.spend / to_lambda(s.load, law) - u_old + u_low
    low_load = s.load + n * law.k * (low - s.length)
    low_e = to_lambda(low_load, law)
    low_spend = low_e * reduced
    new_load = own * law.k * new
    new_e = to_lambda(new_load, law)
    new_spend = new_e * u_new
    a_low, a_new = to_gamma(low_load, law), to_gamma(new_load, law)
    total = a_low + a_new
    m = from_gamma(total, law)
    load = above * law.k * up + m
    m_e, up_e = to_lambda(m, law), to_lambda(load, law)
    both = low_spend + new_spend
    spend = up_e * (u_up + both / m_e)

    m_by_low = (m / total) * (a_low / low_load) * n * law.k
    m_by_new = (m / total) * (a_new / new_load) * own * law.k
    low_spend_by = e * low_spend / low_load * n * law.k + low_e * slope_low
    new_spend_by = e * new_spend / new + new_e * slope_new
    by_load = e * spend / load
    by_m = by_load - e * up_e * both / (m_e * m)
    return (
        load,
        spend,
        above * law.k,
        m_by_low,
        m_by_new,
        by_load * above * law.k + up_e * slope_up,
        by_m * m_by_low + up_e / m_e * low_spend_by,
        by_m * m_by_new + up_e / m_e * new_spend_by,
        low_load,
        m,
    )


@jit
def distance(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Distance of two points, never below a nanometre so that lengths divide."""
    x, y, z = bx - ax, by - ay, bz - az
    return max(1e-6, sqrt(x * x + y * y + z * z))


@jit
def best_place(
    s: Any,
    tx: float,
    ty: float,
    tz: float,
    by_load: float,
    by_spend: float,
    steps: int,
    sprout: Sprout,
    law: Law,
) -> tuple[float, float, float]:
    """Bifurcation of least cost for a terminal at t on segment ``s``.

    The cost is a function of three lengths; at its minimum the weighted unit vectors along
    them cancel (Fermat-Weber). Weiszfeld's iteration with weights that follow the lengths.
    """
    bx = (s.px + s.dx + tx) / 3.0
    by = (s.py + s.dy + ty) / 3.0
    bz = (s.pz + s.dz + tz) / 3.0
    for _ in range(steps):
        up = distance(s.px, s.py, s.pz, bx, by, bz)
        low = distance(bx, by, bz, s.dx, s.dy, s.dz)
        new = distance(bx, by, bz, tx, ty, tz)
        _, _, l_up, l_low, l_new, s_up, s_low, s_new, _, _ = split_value(
            s, up, low, new, sprout, law
        )
        w_up = max(0.0, by_load * l_up + by_spend * s_up) / up
        w_low = max(0.0, by_load * l_low + by_spend * s_low) / low
        w_new = max(0.0, by_load * l_new + by_spend * s_new) / new
        total = w_up + w_low + w_new
        if not total > 0.0:
            break
        nx = (w_up * s.px + w_low * s.dx + w_new * tx) / total
        ny = (w_up * s.py + w_low * s.dy + w_new * ty) / total
        nz = (w_up * s.pz + w_low * s.dz + w_new * tz) / total
        moved = abs(nx - bx) + abs(ny - by) + abs(nz - bz)
        bx, by, bz = nx, ny, nz
        if moved < 1e-3 * s.length:
            break
    return bx, by, bz
