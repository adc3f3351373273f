"""Grow a tree terminal by terminal: take the best branch point, add it, update radii."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from design.tissue.grid import least_depth_along, read
from design.vasculature.growth.cost import (
    Sprout,
    follow_radii,
    place,
    refresh,
    refresh_upwards,
    spread_down,
)
from design.vasculature.growth.fit import growth_factor, seven_integers
from design.vasculature.growth.index import (
    REACH,
    CellIndex,
    Clearances,
    insert,
    nearest_segments,
    neighbours_of,
    widest_of,
)
from design.vasculature.growth.points import Samples
from design.vasculature.growth.propose import propose, trials_for
from design.vasculature.options import Law
from design.vasculature.penalty import PenaltyArrays
from kernels import jit, scalar_jit

CANDIDATES = 10
"""Nearest segments considered for a new terminal."""

PROGRESS = np.dtype(
    [
        ("count", "i8"),
        ("terminals", "i8"),
        ("refresh_at", "i8"),
        ("tried", "i8"),
        ("since", "i8"),
        ("apart", "f8"),
        ("root_radius", "f8"),
        ("smallest", "f8"),
        ("thick", "f8"),
        ("candidates", "i8"),
        ("careful", "i8"),
        ("held", "i8"),
    ]
)
"""Where growth stands.

count : segments; terminals : of them; refresh_at : terminals at which radii are derived anew;
tried : points tried; since : points tried since the last success; apart : share of the mean
spacing that a new terminal must be away from the tree; root_radius : predicted, mm;
smallest : terminal radius, predicted, mm; thick : mean viscosity of the terminals, over μ;
candidates : nearest segments considered for a new terminal; careful : 1 where vessels are kept
from becoming too wide terminal by terminal, not only each time radii are derived anew;
held : first segments that take no branch, nor do those from ``count`` on (a region's growth alone,
`growth.by_regions`).
"""


class Scale(NamedTuple):
    """What sets the radii of the finished tree.

    Attributes
    ----------
    flow_over_drop : float, µL/(s·Pa)
        Q / Δp at the root.
    root_radius : float, mm
        Fixed radius of the root, or 0 where the pressure drop sets it.
    spread : float
        See `GrowthOptions.terminal_spread`; 0 for no limit.
    goal : int
        Terminals of the finished tree.
    volume : float, mm³
    patience : int
        Points tried without success before nearer ones to the tree are let in: what is far is
        reached by wide vessels only once these have come near.
    share : float
        Of the whole tree's terminals, those that this growth has: below 1 for a region's.
    """

    flow_over_drop: float
    root_radius: float
    spread: float
    goal: int
    volume: float
    patience: int
    share: float = 1.0


DONE, MORE_POINTS, FULL_INDEX, REBUILD = 0, 1, 2, 3
"""Why `grow` returned."""

REFRESH = 24
"""Radii are derived anew each time the tree has grown by one in this many terminals."""

GROWTH_POWER = 0.02
"""Root radius grows with about this power of the number of terminals (measured)."""

KEPT = 0.02
"""A vessel must be able to become this part wider than predicted to take on more terminals, times
the part of the tree that has yet to grow: at the end the prediction is exact, and a trunk that is
as wide as it can be would close all of its branches."""

THIN_MARGIN = 1.08
"""A new terminal must be this much wider than the limit: later ones make it thinner."""

_RELAX, _TIGHTEN = 0.93, 1.01
_APART = 0.9


@scalar_jit
def predicted_root_radius(segments: Any, law: Law, scale: Scale) -> float:
    """Root radius of the finished tree, mm."""
    if scale.root_radius > 0.0:
        return scale.root_radius
    n = segments[0].terminals
    now = np.sqrt(np.sqrt(scale.flow_over_drop * segments[0].load / segments[0].flow))
    return now * (scale.goal / scale.share / n) ** GROWTH_POWER


@jit
def thinnest(terminals: int, root_radius: float, law: Law, scale: Scale) -> float:
    """Smallest radius that a terminal may have in a tree of so many, mm; 0 for no limit."""
    if scale.spread <= 0.0:
        return 0.0
    whole = terminals / scale.share
    return THIN_MARGIN * root_radius * whole ** (-1.0 / law.gamma) / scale.spread


@jit
def mean_spacing(terminals: int, scale: Scale) -> float:
    """Mean distance of terminals when there is one more, mm."""
    return float((scale.volume / (terminals + 1)) ** (1.0 / 3.0))


@scalar_jit
def set_allowed_radius(segments: Any, index: CellIndex, room: Clearances, i: int) -> bool:
    """Derive how wide segment ``i`` may grow and list it; False when the index is full."""
    s = segments[i]
    if s.given != 0:
        s.allowed = widest_of(segments, room, i)
        return insert(index, i, s, REACH * s.radius + room.clearance)
    parent, sibling, left, right = neighbours_of(segments, i)
    skip = seven_integers(i, parent, sibling, left, right, -1, -1)
    most = REACH * s.radius + room.wall
    depth = least_depth_along(room.grid, s.px, s.py, s.pz, s.dx, s.dy, s.dz, most, 0.0)
    free = growth_factor(
        index, segments, room, s.px, s.py, s.pz, s.dx, s.dy, s.dz, s.radius, skip, True
    )
    s.allowed = min(depth - room.wall, free * s.radius, widest_of(segments, room, i))
    return insert(index, i, s, REACH * s.radius + room.clearance)


@scalar_jit
def commit(
    segments: Any, count: int, index: CellIndex, room: Clearances, law: Law, fork: Any
) -> bool:
    """Part the fork's segment and add the terminal as segments ``count`` and ``count + 1``.

    The segment itself becomes the upper part; the lower part takes its children. Returns False
    when the index ran out of room (the tree itself is whole).
    """
    i, lower, tip = fork.segment, count, count + 1
    s = segments[i]
    left, right = s.left, s.right
    p = (s.px, s.py, s.pz)
    b = (fork.bx, fork.by, fork.bz)
    place(segments, lower, b, (s.dx, s.dy, s.dz))
    place(segments, tip, b, (fork.tx, fork.ty, fork.tz))
    place(segments, i, p, b)
    segments[lower].parent, segments[tip].parent = i, i
    segments[lower].left, segments[lower].right = left, right
    segments[tip].left, segments[tip].right = -1, -1
    if left >= 0:
        segments[left].parent = lower
    if right >= 0:
        segments[right].parent = lower
    segments[lower].flow, segments[tip].flow = s.flow, fork.flow
    segments[lower].thick, segments[tip].thick = s.thick, fork.thick
    segments[lower].given, segments[tip].given = s.given, 0
    s.left, s.right = lower, tip
    s.radius, segments[lower].radius, segments[tip].radius = fork.up, fork.low, fork.new
    segments[lower].full, segments[tip].full = 0, 0
    s.audited, segments[lower].audited, segments[tip].audited = 0.0, 0.0, 0.0
    refresh(segments, lower, law)
    refresh(segments, tip, law)
    refresh_upwards(segments, i, law)
    done = set_allowed_radius(segments, index, room, i)
    done = set_allowed_radius(segments, index, room, lower) and done
    return set_allowed_radius(segments, index, room, tip) and done


@scalar_jit
def drop_held(nearest: Any, size: int, held: int, count: int) -> int:
    """Keep those of ``found[:size]`` that are numbered from ``held`` to below ``count``."""
    kept = 0
    for n in range(size):
        if held <= nearest[n] < count:
            nearest[kept] = nearest[n]
            kept += 1
    return kept


@scalar_jit
def drop_full(segments: Any, nearest: Any, size: int, flow: float, law: Law) -> int:
    """Keep those of ``found[:size]`` on whose way to the root no vessel becomes too wide."""
    kept = 0
    for n in range(size):
        i = nearest[n]
        above = segments[i].parent
        while above >= 0:
            s = segments[above]
            if s.radius * (1.0 + flow / s.flow) ** (1.0 / law.gamma) > s.allowed:
                break
            above = s.parent
        if above < 0:
            nearest[kept] = i
            kept += 1
    return kept


@scalar_jit
def widen_above(segments: Any, i: int, flow: float, law: Law) -> None:
    """Widen the vessels above segment ``i``, which have just received so much more flow."""
    above = segments[i].parent
    while above >= 0:
        s = segments[above]
        s.radius *= (s.flow / (s.flow - flow)) ** (1.0 / law.gamma)
        above = s.parent


@jit
def derive_radii(segments: Any, progress: Any, law: Law, scale: Scale) -> None:
    """Predict all radii anew."""
    s = progress[0]
    s.root_radius = predicted_root_radius(segments, law, scale)
    slack = 1.0 + KEPT * (1.0 - s.terminals / scale.goal)
    # What holds a region grows by all regions together: none is closed for it.
    for i in range(s.held):
        segments[i].allowed = np.inf
    s.smallest = spread_down(segments, s.count, s.root_radius, slack, law)
    if law.haematocrit >= 0.0:
        _, s.thick = follow_radii(segments, s.count, law)
    s.refresh_at = s.terminals + max(1, s.terminals // REFRESH)


@jit
def grow(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    scale: Scale,
    penalty: PenaltyArrays,
    progress: Any,
    samples: Samples,
    first: int,
    rebuild_at: int,
) -> tuple[int, int]:
    """Try points from ``first`` on until the goal, the end of the points or a rebuild.

    Returns
    -------
    int, int
        Why it returned (`DONE` ...), and the next point.
    """
    s = progress[0]
    nearest = np.empty(s.candidates, np.int32)
    away = np.empty(s.candidates)
    work = trials_for(s.candidates)
    points = samples.at
    spacing = mean_spacing(s.terminals, scale)
    for n in range(first, len(points)):
        if s.terminals >= scale.goal:
            return DONE, n
        if s.terminals >= rebuild_at:
            return REBUILD, n
        t = points[n]
        s.tried += 1
        s.since += 1
        if s.since % scale.patience == 0:
            s.apart *= _RELAX
        least = s.apart * (spacing * samples.near[n])
        size = nearest_segments(index, segments, t[0], t[1], t[2], least, nearest, away)
        if away[0] < least:
            continue
        if s.held > 0:
            size = drop_held(nearest, size, s.held, s.count)
        if s.careful != 0:
            size = drop_full(segments, nearest, size, samples.flow[n], law)
        limit = thinnest(s.terminals + 1, s.root_radius, law, scale)
        whole = (s.terminals + 1) / scale.share
        tip = max(limit, 0.5 * s.root_radius * whole ** (-1.0 / law.gamma))
        shallow = -read(room.grid, t[0], t[1], t[2]) < tip + room.wall
        if shallow and samples.near[n] > 0.0:
            continue
        sprout = Sprout(samples.flow[n], s.thick)
        good, fork = propose(
            segments, index, room, penalty, law, limit, t, sprout, nearest, size, work
        )
        if not good:
            continue
        listed = commit(segments, s.count, index, room, law, fork)
        if s.careful != 0:
            widen_above(segments, fork.segment, fork.flow, law)
        s.count += 2
        s.terminals += 1
        spacing = mean_spacing(s.terminals, scale)
        s.since = 0
        s.apart = min(_APART, s.apart * _TIGHTEN)
        if s.terminals >= s.refresh_at:
            derive_radii(segments, progress, law, scale)
        if not listed:
            return FULL_INDEX, n + 1
    return (DONE if s.terminals >= scale.goal else MORE_POINTS), len(points)


@jit
def list_all(segments: Any, count: int, index: CellIndex, room: Clearances) -> bool:
    """List all segments in an empty index; False when it runs out of room."""
    return list_from(segments, 0, count, index, room)


@jit
def list_from(segments: Any, first: int, end: int, index: CellIndex, room: Clearances) -> bool:
    """List segments ``first`` to ``end`` in an index; False when it runs out of room."""
    for i in range(first, end):
        s = segments[i]
        if not insert(index, i, s, REACH * s.radius + room.clearance):
            return False
    return True
