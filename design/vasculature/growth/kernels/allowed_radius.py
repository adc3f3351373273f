"""Compute how wide each segment of a grown tree may be without collision; count those too wide."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.tissue.grid import least_depth_along
from design.vasculature.growth.kernels.fits import limit_children, limit_smaller_child
from design.vasculature.growth.kernels.index import (
    REACH,
    CellIndex,
    Clearances,
    growth_factor,
    neighbours_of,
    seven_integers,
    widest_of,
)
from kernels import jit, scalar_jit


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
