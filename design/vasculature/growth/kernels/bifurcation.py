"""Cost of a tree with one bifurcation more, and the bifurcation's best place (compiled)."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from design.vasculature.growth.kernels.flow_laws import from_gamma, to_gamma, to_lambda, to_u
from design.vasculature.options import Law
from kernels import jit, scalar_jit


class NewTerminal(NamedTuple):
    """What a new terminal brings: its flow over the mean terminal's, its viscosity over μ."""

    flow: float
    relative_viscosity: float


class TrialBifurcation(NamedTuple):
    """A trial bifurcation on a segment: its place, the new end, three radii (mm).

    ``flow`` and ``relative_viscosity`` are what the new branch brings; see `NewTerminal`.
    """

    segment: np.int64
    bx: float
    by: float
    bz: float
    tx: float
    ty: float
    tz: float
    up: float
    low: float
    new: float
    flow: float
    relative_viscosity: float


@jit
def leaf(length: float, weight: float, law: Law) -> tuple[float, float]:
    """Return a terminal's weighted resistance and cost sum by its flow times viscosity."""
    resistance = weight * law.k * length
    return resistance, to_lambda(resistance, law) * to_u(length, law)


@jit
def join_children(
    resistance0: float,
    cost_sum0: float,
    resistance1: float,
    cost_sum1: float,
    length: float,
    weight: float,
    law: Law,
) -> tuple[float, float, float]:
    """Return a segment's weighted resistance and cost sum, and its children's m.

    ``weight`` is the segment's flow times its viscosity; a missing child has resistance 0.
    """
    m = from_gamma(to_gamma(resistance0, law) + to_gamma(resistance1, law), law)
    resistance = weight * law.k * length + m
    cost_sum = to_lambda(resistance, law) * (
        to_u(length, law) + (cost_sum0 + cost_sum1) / to_lambda(m, law)
    )
    return resistance, cost_sum, m


@scalar_jit
def climb(
    segments: Any,
    index: int,
    resistance: float,
    cost_sum: float,
    flow: float,
    enough: int,
    law: Law,
) -> tuple[float, float, float, float]:
    """Return the rise of the tree's cost once ``index`` has these sums, and all above more flow.

    Walks to the root, or to the first segment of ``enough`` times ``flow`` and on from there by
    the derivatives kept in it (`spread_down`). The walk is exact; the neglected part is of second
    order in the change there, about 1/enough squared.

    Returns
    -------
    rise : float
        Of the cost K_root.
    by_resistance, by_cost_sum : float
        Derivatives of the cost with respect to ``resistance`` and ``cost_sum``.
    radius : float, mm
        Of segment ``index``, as the radius stands of the segment where the walk ended.
    """
    e = 0.25 * law.lam
    # Derivatives of this level's (resistance, cost sum) by those at ``index``: a 2 x 2 matrix.
    ll, ls, sl, ss = 1.0, 0.0, 0.0, 1.0
    share = 1.0
    here = index
    much = enough * flow
    while segments[here].parent >= 0 and segments[here].flow < much:
        up = segments[here].parent
        other = segments[up].left
        if other == here:
            other = segments[up].right
        a0 = to_gamma(resistance, law)
        total, both = a0, cost_sum
        if other >= 0:
            total += to_gamma(segments[other].weighted_resistance, law)
            both += segments[other].cost_sum
        m = from_gamma(total, law)
        mass = (segments[up].flow + flow) * law.k * segments[up].length
        if law.haematocrit >= 0.0:
            mass *= segments[up].relative_viscosity
        above = mass + m
        me, we = to_lambda(m, law), to_lambda(above, law)
        up_cost_sum = we * (to_u(segments[up].length, law) + both / me)
        m_by_resistance = (m / total) * (a0 / resistance)
        cost_sum_by_resistance = m_by_resistance * e * (up_cost_sum / above - we * both / (me * m))
        cost_sum_by_cost_sum = we / me
        sl, ss = (
            cost_sum_by_resistance * ll + cost_sum_by_cost_sum * sl,
            cost_sum_by_resistance * ls + cost_sum_by_cost_sum * ss,
        )
        ll, ls = m_by_resistance * ll, m_by_resistance * ls
        share *= resistance / m
        resistance, cost_sum, here = above, up_cost_sum, up
    end = segments[here]
    rise = (
        end.by_resistance * (resistance - end.weighted_resistance)
        + end.by_cost_sum * (cost_sum - end.cost_sum)
        + flow * end.by_one
    )
    return (
        rise,
        end.by_resistance * ll + end.by_cost_sum * sl,
        end.by_resistance * ls + end.by_cost_sum * ss,
        end.radius * sqrt(sqrt(share)),
    )


@jit
def distance(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Distance of two points, never below a nanometre so that lengths divide."""
    x, y, z = bx - ax, by - ay, bz - az
    return max(1e-6, sqrt(x * x + y * y + z * z))


@jit
def split_value(
    s: Any, up: float, low: float, new: float, new_terminal: NewTerminal, law: Law
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Return weighted resistance and cost sum above a bifurcation on ``s``, and their derivatives.

    Parameters
    ----------
    s : record
        The segment as it is.
    up, low, new : float, mm
        Lengths from its start to the bifurcation, on to its end, and to the new terminal.
    new_terminal : NewTerminal
        The new terminal's flow and viscosity.

    Returns
    -------
    resistance, cost_sum : float
        Of the upper part, over the lower part and the new terminal.
    resistance_by_up, resistance_by_low, resistance_by_new : float
    cost_sum_by_up, cost_sum_by_low, cost_sum_by_new : float
    low_resistance, m : float
        Weighted resistance of the lower part; m of it and the new terminal.
    """
    e = 0.25 * law.lam
    n, above, own = s.flow, s.flow + new_terminal.flow, new_terminal.flow
    if law.haematocrit >= 0.0:
        n, above, own = (
            n * s.relative_viscosity,
            above * s.relative_viscosity,
            own * new_terminal.relative_viscosity,
        )
    # Both cases here in one: LLVM would work out the powers of `to_u` in any case, to choose then.
    if law.u == 1.0:
        u_old, u_up, u_low, u_new = s.length, up, low, new
        slope_up, slope_low, slope_new = 1.0, 1.0, 1.0
    else:
        u_old, u_up, u_low, u_new = s.length**law.u, up**law.u, low**law.u, new**law.u
        slope_up, slope_low, slope_new = law.u * u_up / up, law.u * u_low / low, law.u * u_new / new
    # C* of the lower part: the old one with the length exchanged.
    reduced = s.cost_sum / to_lambda(s.weighted_resistance, law) - u_old + u_low
    low_resistance = s.weighted_resistance + n * law.k * (low - s.length)
    low_e = to_lambda(low_resistance, law)
    low_cost_sum = low_e * reduced
    new_resistance = own * law.k * new
    new_e = to_lambda(new_resistance, law)
    new_cost_sum = new_e * u_new
    a_low, a_new = to_gamma(low_resistance, law), to_gamma(new_resistance, law)
    total = a_low + a_new
    m = from_gamma(total, law)
    resistance = above * law.k * up + m
    m_e, up_e = to_lambda(m, law), to_lambda(resistance, law)
    both = low_cost_sum + new_cost_sum
    cost_sum = up_e * (u_up + both / m_e)

    m_by_low = (m / total) * (a_low / low_resistance) * n * law.k
    m_by_new = (m / total) * (a_new / new_resistance) * own * law.k
    low_cost_sum_by = e * low_cost_sum / low_resistance * n * law.k + low_e * slope_low
    new_cost_sum_by = e * new_cost_sum / new + new_e * slope_new
    by_resistance = e * cost_sum / resistance
    by_m = by_resistance - e * up_e * both / (m_e * m)
    return (
        resistance,
        cost_sum,
        above * law.k,
        m_by_low,
        m_by_new,
        by_resistance * above * law.k + up_e * slope_up,
        by_m * m_by_low + up_e / m_e * low_cost_sum_by,
        by_m * m_by_new + up_e / m_e * new_cost_sum_by,
        low_resistance,
        m,
    )


@jit
def best_place(
    s: Any,
    tx: float,
    ty: float,
    tz: float,
    by_resistance: float,
    by_cost_sum: float,
    steps: int,
    new_terminal: NewTerminal,
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
            s, up, low, new, new_terminal, law
        )
        w_up = max(0.0, by_resistance * l_up + by_cost_sum * s_up) / up
        w_low = max(0.0, by_resistance * l_low + by_cost_sum * s_low) / low
        w_new = max(0.0, by_resistance * l_new + by_cost_sum * s_new) / new
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
