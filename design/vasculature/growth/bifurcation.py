"""Find the least-cost branch point on a segment for a new terminal, by a linear cost model."""

from __future__ import annotations

from math import sqrt
from typing import Any

from design.vasculature.growth.cost import Sprout, from_gamma, to_gamma, to_lambda
from design.vasculature.options import Law
from kernels import jit


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
