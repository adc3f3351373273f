"""Grow a tree terminal by terminal: propose the cheapest bifurcation, add it, update radii."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from design.geometry import point_segment
from design.tissue.grid import read
from design.vasculature.growth.kernels.allowed_radius import allowed_radius
from design.vasculature.growth.kernels.bifurcation import (
    NewTerminal,
    distance,
)
from design.vasculature.growth.kernels.cost import (
    follow_radii,
    place,
    refresh,
    refresh_upwards,
    spread_down,
)
from design.vasculature.growth.kernels.index import (
    REACH,
    CellIndex,
    Clearances,
    clearance_between,
    in_tissue,
    insert,
    nearest_segments,
    widest_of,
)
from design.vasculature.growth.kernels.points import Samples
from design.vasculature.growth.kernels.proposals import propose, trials_for
from design.vasculature.growth.kernels.search_settings import RADII, SPACING
from design.vasculature.options import GrowthOptions, Law, angles_fit, shares_fit
from design.vasculature.penalty import PenaltyArrays
from kernels import jit, scalar_jit

DONE, MORE_POINTS, FULL_INDEX, REBUILD = 0, 1, 2, 3
"""Why `grow` returned."""
PROGRESS = np.dtype(
    [
        ("count", "i8"),
        ("terminals", "i8"),
        ("refresh_at", "i8"),
        ("tried", "i8"),
        ("since", "i8"),
        ("min_spacing_factor", "f8"),
        ("root_radius", "f8"),
        ("smallest", "f8"),
        ("relative_viscosity", "f8"),
        ("candidates", "i8"),
        ("check_each_terminal", "i8"),
        ("frozen_count", "i8"),
    ]
)
"""Where growth stands.

count : segments; terminals : of them; refresh_at : terminals at which radii are derived anew;
tried : points tried; since : points tried since the last success; min_spacing_factor : share of the
mean spacing that a new terminal must be away from the tree; root_radius : predicted, mm;
smallest : terminal radius, predicted, mm; relative_viscosity : mean of the terminals;
candidates : nearest segments considered for a new terminal; check_each_terminal : 1 where vessels
are kept from becoming too wide terminal by terminal, not only each time radii are derived anew;
frozen_count : first segments that take no branch, nor do those from ``count`` on (a region's growth
alone, `growth.regions`).
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

    @classmethod
    def of(cls, options: GrowthOptions, volume_mm3: float, goal: int, spread: float) -> Scale:
        """Return the scale of a tree of ``goal`` terminals; ``spread`` needs a smallest radius."""
        drop = options.flow_ul_s(volume_mm3) / options.pressure_drop_pa
        smallest = options.smallest_radius_mm
        if not smallest:
            return cls(drop, 0.0, 0.0, goal, volume_mm3, SPACING.thin_patience)
        root = smallest * spread * goal ** (1.0 / options.murray_exponent)
        return cls(drop, root, spread, goal, volume_mm3, SPACING.wide_patience)

    def first_radius(self, law: Law, tissue_mm3: float) -> float:
        """Return the root's radius before there is a tree, mm: a pipe twice the tissue's length."""
        if self.root_radius > 0:
            return self.root_radius
        resistance = 2.0 * law.k * float(np.cbrt(tissue_mm3))
        return float((self.flow_over_drop * resistance) ** 0.25)


@jit
def first_pair(
    segments: Any,
    clearances: Clearances,
    law: Law,
    root_radius: float,
    samples: Samples,
    least: float,
) -> bool:
    """Grow the stem's two first terminals from two of the samples; False when none fit.

    Each is at least ``least`` away from the stem and from the other one's segment.
    """
    s, points, flow = segments[0], samples.at, samples.flow
    e = (s.dx, s.dy, s.dz)
    one = -1
    for n in range(len(points)):
        t = points[n]
        length = distance(e[0], e[1], e[2], t[0], t[1], t[2])
        if length < least:
            continue
        if one < 0:
            radius = root_radius * 0.5 ** (1.0 / law.gamma)
            if _stands(clearances, s, t, radius, root_radius):
                one = n
            continue
        other = points[one]
        m = distance(e[0], e[1], e[2], other[0], other[1], other[2])
        a, b = np.sqrt(np.sqrt(flow[n] * length)), np.sqrt(np.sqrt(flow[one] * m))
        total = (a**law.gamma + b**law.gamma) ** (1.0 / law.gamma)
        r0, r1 = root_radius * b / total, root_radius * a / total
        if not (
            _stands(clearances, s, t, r1, root_radius)
            and _stands(clearances, s, other, r0, root_radius)
        ):
            continue
        gap = r0 + r1 + clearance_between(clearances, r0, r1) + 0.25 * least
        if _ends_apart(e, t, other) < gap:
            continue
        if clearances.limits.on and not (
            angles_fit(clearances.limits, (s.px, s.py, s.pz), e, other, t)
            and shares_fit(clearances.limits, flow[one], flow[n])
        ):
            continue
        for i in range(1, 3):
            place(segments, i, e, (other[0], other[1], other[2]) if i == 1 else (t[0], t[1], t[2]))
            segments[i].parent = 0
            segments[i].left, segments[i].right = -1, -1
            segments[i].full = 0
            segments[i].flow = flow[one] if i == 1 else flow[n]
            refresh(segments, i, law)
        segments[0].left, segments[0].right = 1, 2
        refresh(segments, 0, law)
        return True
    return False


@jit
def _stands(clearances: Clearances, stem: Any, t: Any, radius: float, root_radius: float) -> bool:
    """Whether a vessel from the stem's end to ``t`` is in the tissue and leaves the stem."""
    gap = radius + root_radius + clearance_between(clearances, radius, root_radius)
    away, _ = point_segment(t[0], t[1], t[2], stem.px, stem.py, stem.pz, stem.dx, stem.dy, stem.dz)
    return bool(
        away >= gap and in_tissue(clearances, stem.dx, stem.dy, stem.dz, t[0], t[1], t[2], radius)
    )


@jit
def _ends_apart(e: tuple[float, float, float], t: Any, other: Any) -> float:
    """Least distance of either end from the other one's segment."""
    one, _ = point_segment(t[0], t[1], t[2], e[0], e[1], e[2], other[0], other[1], other[2])
    two, _ = point_segment(other[0], other[1], other[2], e[0], e[1], e[2], t[0], t[1], t[2])
    return min(one, two)


@scalar_jit
def predicted_root_radius(segments: Any, law: Law, scale: Scale) -> float:
    """Root radius of the finished tree, mm."""
    if scale.root_radius > 0.0:
        return scale.root_radius
    n = segments[0].terminals
    now = np.sqrt(
        np.sqrt(scale.flow_over_drop * segments[0].weighted_resistance / segments[0].flow)
    )
    return now * (scale.goal / scale.share / n) ** RADII.growth_power


@jit
def thinnest(terminals: int, root_radius: float, law: Law, scale: Scale) -> float:
    """Smallest radius that a terminal may have in a tree of so many, mm; 0 for no limit."""
    if scale.spread <= 0.0:
        return 0.0
    whole = terminals / scale.share
    return RADII.thin_margin * root_radius * whole ** (-1.0 / law.gamma) / scale.spread


@jit
def mean_spacing(terminals: int, scale: Scale) -> float:
    """Mean distance of terminals when there is one more, mm."""
    return float((scale.volume / (terminals + 1)) ** (1.0 / 3.0))


@scalar_jit
def set_allowed_radius(segments: Any, index: CellIndex, clearances: Clearances, i: int) -> bool:
    """Derive how wide segment ``i`` may grow and list it; False when the index is full."""
    s = segments[i]
    if s.given != 0:
        s.allowed = widest_of(segments, clearances, i)
    else:
        s.allowed = allowed_radius(segments, i, index, clearances, True)
    return insert(index, i, s, REACH * s.radius + clearances.clearance)


@scalar_jit
def commit(
    segments: Any, count: int, index: CellIndex, clearances: Clearances, law: Law, fork: Any
) -> bool:
    """Part the fork's segment and add the terminal as segments ``count`` and ``count + 1``.

    The segment itself becomes the upper part; the lower part takes its children. Returns False
    when the index is full (the tree itself is whole).
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
    segments[lower].relative_viscosity, segments[tip].relative_viscosity = (
        s.relative_viscosity,
        fork.relative_viscosity,
    )
    segments[lower].given, segments[tip].given = s.given, 0
    s.left, s.right = lower, tip
    s.radius, segments[lower].radius, segments[tip].radius = fork.up, fork.low, fork.new
    segments[lower].full, segments[tip].full = 0, 0
    s.audited, segments[lower].audited, segments[tip].audited = 0.0, 0.0, 0.0
    refresh(segments, lower, law)
    refresh(segments, tip, law)
    refresh_upwards(segments, i, law)
    done = set_allowed_radius(segments, index, clearances, i)
    done = set_allowed_radius(segments, index, clearances, lower) and done
    return set_allowed_radius(segments, index, clearances, tip) and done


@scalar_jit
def drop_frozen(nearest: Any, size: int, frozen_count: int, count: int) -> int:
    """Keep those of ``nearest[:size]`` that are numbered from the frozen ones to ``count``."""
    kept = 0
    for n in range(size):
        if frozen_count <= nearest[n] < count:
            nearest[kept] = nearest[n]
            kept += 1
    return kept


@scalar_jit
def drop_full(segments: Any, nearest: Any, size: int, flow: float, law: Law) -> int:
    """Keep those of ``nearest[:size]`` on whose way to the root no vessel becomes too wide."""
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
    slack = 1.0 + RADII.widening_reserve * (1.0 - s.terminals / scale.goal)
    # What holds a region grows by all regions together: none is closed for it.
    for i in range(s.frozen_count):
        segments[i].allowed = np.inf
    s.smallest = spread_down(segments, s.count, s.root_radius, slack, law)
    if law.haematocrit >= 0.0:
        _, s.relative_viscosity = follow_radii(segments, s.count, law)
    s.refresh_at = s.terminals + max(1, s.terminals // RADII.refresh_divisor)


@jit
def grow(
    segments: Any,
    index: CellIndex,
    clearances: Clearances,
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
            s.min_spacing_factor *= SPACING.relax
        least = s.min_spacing_factor * (spacing * samples.near[n])
        size = nearest_segments(index, segments, t[0], t[1], t[2], least, nearest, away)
        if away[0] < least:
            continue
        if s.frozen_count > 0:
            size = drop_frozen(nearest, size, s.frozen_count, s.count)
        if s.check_each_terminal != 0:
            size = drop_full(segments, nearest, size, samples.flow[n], law)
        limit = thinnest(s.terminals + 1, s.root_radius, law, scale)
        whole = (s.terminals + 1) / scale.share
        tip = max(limit, 0.5 * s.root_radius * whole ** (-1.0 / law.gamma))
        shallow = -read(clearances.grid, t[0], t[1], t[2]) < tip + clearances.wall
        if shallow and samples.near[n] > 0.0:
            continue
        new_terminal = NewTerminal(samples.flow[n], s.relative_viscosity)
        good, fork = propose(
            segments, index, clearances, penalty, law, limit, t, new_terminal, nearest, size, work
        )
        if not good:
            continue
        listed = commit(segments, s.count, index, clearances, law, fork)
        if s.check_each_terminal != 0:
            widen_above(segments, fork.segment, fork.flow, law)
        s.count += 2
        s.terminals += 1
        spacing = mean_spacing(s.terminals, scale)
        s.since = 0
        s.min_spacing_factor = min(SPACING.most, s.min_spacing_factor * SPACING.tighten)
        if s.terminals >= s.refresh_at:
            derive_radii(segments, progress, law, scale)
        if not listed:
            return FULL_INDEX, n + 1
    return (DONE if s.terminals >= scale.goal else MORE_POINTS), len(points)
