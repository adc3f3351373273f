"""Find a new end point for a terminal that has no place, or that is left of a pruned branch."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry import point_segment
from design.vasculature.growth.kernels.bifurcation import distance
from design.vasculature.growth.kernels.cost import place, refresh, refresh_upwards
from design.vasculature.growth.kernels.fits import limit_children, limit_smaller_child, start_fits
from design.vasculature.growth.kernels.flow_laws import from_gamma, to_gamma
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
)
from design.vasculature.growth.kernels.repair_settings import GOLDEN_ANGLE, REPAIR
from design.vasculature.options import Law
from kernels import jit, scalar_jit


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
