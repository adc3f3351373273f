"""Grow a tree terminal by terminal: propose the cheapest bifurcation, add it, update radii."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry import point_segment
from design.tissue.grid import read
from design.vasculature.growth.kernels.checks import (
    allowed_radius,
    fits,
)
from design.vasculature.growth.kernels.cost import (
    EXACT_FLOW_RATIO,
    NewTerminal,
    TrialBifurcation,
    best_place,
    climb,
    distance,
    follow_radii,
    place,
    refresh,
    refresh_upwards,
    split_value,
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
from design.vasculature.options import GrowthOptions, Law, angles_fit, shares_fit
from design.vasculature.penalty import PenaltyArrays, weigh_rise
from kernels import jit, scalar_jit


class PlaceSearch(NamedTuple):
    """How thoroughly the bifurcation of a new terminal is searched for."""

    nearest: int = 10
    many_nearest: int = 40
    """Segments considered; more for given points missed at first, or with a flow ratio."""
    retried: int = 4
    """Of these the cheapest, for which other places than the best are tried."""
    weiszfeld_steps: int = 8
    """At most."""
    axis_places: int = 7
    """Places tried along a segment that mustn't bend, before the best is refined."""
    halvings: int = 8
    """Steps in which a place is refined."""


class PredictedRadii(NamedTuple):
    """How the finished tree's radii are predicted while it grows."""

    refresh_divisor: int = 24
    """Radii are derived anew each time the tree has grown by one in so many terminals."""
    growth_power: float = 0.02
    """Power of the number of terminals with which the root's radius grows (measured)."""
    widening_reserve: float = 0.02
    """A vessel must be able to become this part wider than predicted to take on more terminals,
    times the part of the tree that has yet to grow: at the end the prediction is exact, and a
    trunk that is as wide as it can be would close all of its branches."""
    thin_margin: float = 1.08
    """A new terminal must be this much wider than the limit: later ones make it thinner."""


class TerminalSpacing(NamedTuple):
    """Distance of a new terminal from the tree, over the terminals' mean spacing."""

    most: float = 0.9
    """At first, and at most."""
    relax: float = 0.93
    tighten: float = 1.01
    """Factors after points without a place, and after one with."""
    thin_patience: int = 6
    wide_patience: int = 400
    """`Scale.patience` of thin trees, which get everywhere at once, and of those with a
    smallest radius: with that of the former, 95 % of a folded slab lay within 7.9 mm of a
    lumen, not 1.9."""


SEARCH, RADII, SPACING = PlaceSearch(), PredictedRadii(), TerminalSpacing()
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


class Trials(NamedTuple):
    """Scratch of `propose`, for up to k segments.

    Attributes
    ----------
    costs, places, slopes, order : (k,), (k, 3), (k, 3) float64, (k,) int64
        Of the best place on each segment; the segments from the cheapest on.
    values, others, rank : (m,), (m, 3) float64, (m,) int64
        The same of other places.
    """

    costs: NDArray[np.float64]
    places: NDArray[np.float64]
    slopes: NDArray[np.float64]
    order: NDArray[np.int64]
    values: NDArray[np.float64]
    others: NDArray[np.float64]
    rank: NDArray[np.int64]


@jit
def trials_for(k: int) -> Trials:
    """Make the scratch for up to ``k`` segments."""
    m = SEARCH.retried * 6
    return Trials(
        np.empty(k),
        np.empty((k, 3)),
        np.empty((k, 3)),
        np.empty(k, np.int64),
        np.empty(m),
        np.empty((m, 3)),
        np.empty(m, np.int64),
    )


@scalar_jit
def sort_by(values: Any, size: int, order: Any) -> None:
    """Write the numbers of ``values[:size]`` into ``order``, least first, equal ones as they stand.

    NaN becomes inf, and so stands last.
    """
    for n in range(size):
        if not values[n] < np.inf:
            values[n] = np.inf
        at = n
        while at > 0 and values[order[at - 1]] > values[n]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = n


@scalar_jit
def trial(
    segments: Any,
    i: int,
    b: Any,
    t: Any,
    new_terminal: NewTerminal,
    law: Law,
) -> tuple[Any, float]:
    """Fork with its radii, and the rise of the cost, of a terminal at ``t`` by way of ``b``."""
    s = segments[i]
    up = distance(s.px, s.py, s.pz, b[0], b[1], b[2])
    low = distance(b[0], b[1], b[2], s.dx, s.dy, s.dz)
    new = distance(b[0], b[1], b[2], t[0], t[1], t[2])
    resistance, cost_sum, _, _, _, _, _, _, low_resistance, m = split_value(
        s, up, low, new, new_terminal, law
    )
    rise, _, _, r_up = climb(
        segments, i, resistance, cost_sum, new_terminal.flow, EXACT_FLOW_RATIO, law
    )
    r_low = r_up * np.sqrt(np.sqrt(low_resistance / m))
    r_new = r_up * np.sqrt(
        np.sqrt(new_terminal.flow * new_terminal.relative_viscosity * law.k * new / m)
    )
    fork = TrialBifurcation(
        np.int64(i),
        b[0],
        b[1],
        b[2],
        t[0],
        t[1],
        t[2],
        r_up,
        r_low,
        r_new,
        new_terminal.flow,
        new_terminal.relative_viscosity,
    )
    return fork, rise


@scalar_jit
def not_too_thin(segments: Any, fork: Any, limit: float) -> bool:
    """Whether the new terminal, and the parted segment if it is one, are wide enough."""
    if fork.new < limit:
        return False
    return bool(segments[fork.segment].left >= 0 or fork.low >= limit)


@scalar_jit
def estimate(
    segments: Any,
    i: int,
    t: Any,
    new_terminal: NewTerminal,
    penalty: PenaltyArrays,
    place_out: Any,
    slopes: Any,
    law: Law,
) -> float:
    """Best place on segment ``i`` by the linear model, and the model's cost there.

    ``place_out`` (3,) receives the place, ``slopes`` (3,) the model: the cost at no resistance and
    cost sum, and its derivatives by the two. A trunk's segment is left on its axis.
    """
    s = segments[i]
    bx = (s.px + s.dx + t[0]) / 3.0
    by = (s.py + s.dy + t[1]) / 3.0
    bz = (s.pz + s.dz + t[2]) / 3.0
    resistance, cost_sum, _, _, _, _, _, _, _, _ = split_value(
        s,
        distance(s.px, s.py, s.pz, bx, by, bz),
        distance(bx, by, bz, s.dx, s.dy, s.dz),
        distance(bx, by, bz, t[0], t[1], t[2]),
        new_terminal,
        law,
    )
    rise, by_resistance, by_cost_sum, _ = climb(
        segments, i, resistance, cost_sum, new_terminal.flow, EXACT_FLOW_RATIO, law
    )
    slopes[0] = rise - by_resistance * resistance - by_cost_sum * cost_sum
    slopes[1] = by_resistance
    slopes[2] = by_cost_sum
    if s.given != 0:
        return best_on_axis(segments, s, t, new_terminal, penalty, place_out, slopes, law)
    bx, by, bz = best_place(
        s, t[0], t[1], t[2], by_resistance, by_cost_sum, SEARCH.weiszfeld_steps, new_terminal, law
    )
    place_out[0], place_out[1], place_out[2] = bx, by, bz
    if penalty.on:
        return best_penalised(segments, s, t, new_terminal, penalty, place_out, slopes, law)
    return model(s, place_out, t, slopes, new_terminal, law)


@scalar_jit
def value_at(
    segments: Any,
    s: Any,
    b: Any,
    t: Any,
    new_terminal: NewTerminal,
    penalty: PenaltyArrays,
    slopes: Any,
    law: Law,
) -> float:
    """What place ``b`` is compared by: the model's rise of the cost, a penalty included."""
    rise = model(s, b, t, slopes, new_terminal, law)
    return weigh_rise(penalty, b, segments[0].cost_sum, rise)


@scalar_jit
def best_on_axis(
    segments: Any,
    s: Any,
    t: Any,
    new_terminal: NewTerminal,
    penalty: PenaltyArrays,
    place_out: Any,
    slopes: Any,
    law: Law,
) -> float:
    """Best place on a segment's axis: the best of some, then halving steps about it."""
    best, along = np.inf, 0.5
    step = 1.0 / (SEARCH.axis_places + 1)
    for n in range(SEARCH.axis_places):
        at = (n + 1) * step
        value = value_at(segments, s, along_axis(s, at), t, new_terminal, penalty, slopes, law)
        if value < best:
            best, along = value, at
    for _ in range(SEARCH.halvings):
        step *= 0.5
        middle = along
        for at in (middle - step, middle + step):
            value = value_at(segments, s, along_axis(s, at), t, new_terminal, penalty, slopes, law)
            if value < best:
                best, along = value, at
    place_out[0], place_out[1], place_out[2] = along_axis(s, along)
    return best


@jit
def along_axis(s: Any, part: float) -> tuple[float, float, float]:
    """The point a part of the way along a segment."""
    return (
        s.px + part * (s.dx - s.px),
        s.py + part * (s.dy - s.py),
        s.pz + part * (s.dz - s.pz),
    )


@scalar_jit
def other_place(s: Any, t: Any, kind: int) -> tuple[float, float, float]:
    """Return the place of a kind (0 to 5): on the axis, or towards the terminal."""
    along, pull = 0.25 + 0.25 * (kind % 3), 0.3 * (kind // 3)
    return (
        (1.0 - pull) * (s.px + along * (s.dx - s.px)) + pull * t[0],
        (1.0 - pull) * (s.py + along * (s.dy - s.py)) + pull * t[1],
        (1.0 - pull) * (s.pz + along * (s.dz - s.pz)) + pull * t[2],
    )


@scalar_jit
def best_penalised(
    segments: Any,
    s: Any,
    t: Any,
    new_terminal: NewTerminal,
    penalty: PenaltyArrays,
    place_out: Any,
    slopes: Any,
    law: Law,
) -> float:
    """From the best place without a penalty to the best with it.

    The better of that and six others, then steps along the axes that halve where none helps.
    """
    best = value_at(segments, s, place_out, t, new_terminal, penalty, slopes, law)
    for kind in range(6):
        at = other_place(s, t, kind)
        value = value_at(segments, s, at, t, new_terminal, penalty, slopes, law)
        if value < best:
            best = value
            place_out[0], place_out[1], place_out[2] = at
    step = 0.25 * (s.length + distance(place_out[0], place_out[1], place_out[2], t[0], t[1], t[2]))
    for _ in range(SEARCH.halvings):
        better = False
        for axis in range(3):
            for sign in (-1.0, 1.0):
                before = place_out[axis]
                place_out[axis] = before + sign * step
                value = value_at(segments, s, place_out, t, new_terminal, penalty, slopes, law)
                if value < best:
                    best = value
                    better = True
                else:
                    place_out[axis] = before
        if not better:
            step *= 0.5
    return best


@scalar_jit
def model(s: Any, b: Any, t: Any, slopes: Any, new_terminal: NewTerminal, law: Law) -> float:
    """Cost of place ``b`` by the linear model."""
    resistance, cost_sum, _, _, _, _, _, _, _, _ = split_value(
        s,
        distance(s.px, s.py, s.pz, b[0], b[1], b[2]),
        distance(b[0], b[1], b[2], s.dx, s.dy, s.dz),
        distance(b[0], b[1], b[2], t[0], t[1], t[2]),
        new_terminal,
        law,
    )
    return slopes[0] + slopes[1] * resistance + slopes[2] * cost_sum


@scalar_jit
def propose(
    segments: Any,
    index: CellIndex,
    clearances: Clearances,
    penalty: PenaltyArrays,
    law: Law,
    limit: float,
    t: Any,
    new_terminal: NewTerminal,
    nearest: Any,
    size: int,
    work: Trials,
) -> tuple[bool, Any]:
    """The cheapest fork that fits, of the segments ``nearest[:size]``; ``work`` is overwritten."""
    fork = TrialBifurcation(np.int64(-1), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    costs, places, slopes, order = work.costs, work.places, work.slopes, work.order
    for n in range(size):
        costs[n] = np.inf
        # The root's own segment is the stem: it stays as the user placed it.
        free = nearest[n] > 0 or segments[0].given != 0
        if free and segments[nearest[n]].full == 0:
            costs[n] = estimate(
                segments, nearest[n], t, new_terminal, penalty, places[n], slopes[n], law
            )
    sort_by(costs, size, order)
    for rank in range(size):
        n = order[rank]
        if costs[n] == np.inf:
            break
        fork, _ = trial(segments, nearest[n], places[n], t, new_terminal, law)
        if not_too_thin(segments, fork, limit) and fits(index, segments, clearances, fork):
            return True, fork
    others, values = work.others, work.values
    values[:] = np.inf
    for rank in range(min(SEARCH.retried, size)):
        n = order[rank]
        if costs[n] == np.inf:
            break
        s = segments[nearest[n]]
        for kind in range(6):
            if s.given != 0 and kind > 2:
                continue
            at = other_place(s, t, kind)
            others[rank * 6 + kind, 0] = at[0]
            others[rank * 6 + kind, 1] = at[1]
            others[rank * 6 + kind, 2] = at[2]
            values[rank * 6 + kind] = value_at(
                segments, s, at, t, new_terminal, penalty, slopes[n], law
            )
    sort_by(values, len(values), work.rank)
    for n in work.rank:
        if values[n] == np.inf:
            break
        i = nearest[order[n // 6]]
        fork, _ = trial(segments, i, others[n], t, new_terminal, law)
        if not_too_thin(segments, fork, limit) and fits(index, segments, clearances, fork):
            return True, fork
    return False, fork


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
