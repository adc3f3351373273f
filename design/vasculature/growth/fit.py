"""Check that a trial bifurcation fits: in the tissue, between neighbours, as a joint."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry import point_segment, segment_segment
from design.tissue.grid import depth_along
from design.vasculature.growth.clearances import Clearances, TrialBifurcation, neighbours_of
from design.vasculature.growth.index import REACH, CellIndex, cell_range
from design.vasculature.growth.joints import joint_fits
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
