"""Propose where a new terminal joins a tree: trial bifurcations, best first (compiled)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.kernels.bifurcation import (
    NewTerminal,
    TrialBifurcation,
    best_place,
    climb,
    distance,
    split_value,
)
from design.vasculature.growth.kernels.cost import EXACT_FLOW_RATIO
from design.vasculature.growth.kernels.fits import fits
from design.vasculature.growth.kernels.index import CellIndex, Clearances
from design.vasculature.growth.kernels.search_settings import SEARCH
from design.vasculature.options import Law
from design.vasculature.penalty import PenaltyArrays, weigh_rise
from kernels import jit, scalar_jit


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
