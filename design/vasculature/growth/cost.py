r"""Compute a tree's cost Σ ℓᵘ r^λ (length, radius) from sums per segment, updated as it grows.

A segment that feeds terminals of the relative flows q_t has the flow n = Σ q_t, in units of the
mean terminal's; with equal terminal flows n is their number. Of the quantities of Karch et al.
1999 (R\*, C\*, the ratios β) these two are kept for each segment:

- load   W = n R\*
- spend  K = W^(λ/4) C\*

Put into R\* = 8μℓ/π + 1/(β_l⁴/R\*_l + β_r⁴/R\*_r) with β_l = (1 + x^-γ)^(-1/γ) and
x = (n_l R\*_l / n_r R\*_r)^¼ = (W_l/W_r)^¼, the bifurcation's algebra shrinks to

- m = (W_l^(γ/4) + W_r^(γ/4))^(4/γ), the load of both children together
- W = n k v ℓ + m, with k = 8μ/π; a terminal's is q k v ℓ
- β_l⁴ = W_l / m
- K = W^(λ/4) (ℓᵘ + (K_l + K_r) / m^(λ/4))

because n_l + n_r = n and β_l⁴/R\*_l = n_l / m. At the root r⁴ = Q R\*/Δp = (Q/n) W/Δp, so the
cost r_root^λ C\*_root is K_root times a constant: growth compares K_root alone.

v is the segment's viscosity over μ: 1 for a Newtonian fluid, else what
`viscosity` gives for its radius. Where a segment has one child alone (a bend of a given trunk), m
is the child's W.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from design.vasculature.options import Law
from kernels import jit, scalar_jit


@jit
def to_gamma(load: float, law: Law) -> float:
    """W^(γ/4)."""
    if law.gamma == 3.0:
        return sqrt(load * sqrt(load))
    return load ** (0.25 * law.gamma)


@jit
def from_gamma(total: float, law: Law) -> float:
    """S^(4/γ), the inverse of `to_gamma`."""
    if law.gamma == 3.0:
        return total * np.cbrt(total)
    return total ** (4.0 / law.gamma)


@jit
def to_lambda(load: float, law: Law) -> float:
    """W^(λ/4)."""
    if law.lam == 2.0:
        return sqrt(load)
    return load ** (0.25 * law.lam)


@jit
def to_u(length: float, law: Law) -> float:
    """ℓᵘ."""
    if law.u == 1.0:
        return length
    return length**law.u


class Sprout(NamedTuple):
    """What a new terminal brings: its flow over the mean terminal's, its viscosity over μ."""

    flow: float
    thick: float


@jit
def leaf(length: float, weight: float, law: Law) -> tuple[float, float]:
    """Load and spend of a terminal segment; ``weight`` is its flow times its viscosity."""
    load = weight * law.k * length
    return load, to_lambda(load, law) * to_u(length, law)


@jit
def joined_load(
    load0: float, spend0: float, load1: float, spend1: float, length: float, weight: float, law: Law
) -> tuple[float, float, float]:
    """Load and spend of a segment over two children, and the children's joint load m.

    ``weight`` is the segment's flow times its viscosity; a child that isn't there has load 0.
    """
    m = from_gamma(to_gamma(load0, law) + to_gamma(load1, law), law)
    load = weight * law.k * length + m
    spend = to_lambda(load, law) * (to_u(length, law) + (spend0 + spend1) / to_lambda(m, law))
    return load, spend, m


ENOUGH = 64
"""Flow, over that of a new terminal, above which this one changes a segment so little that the
linear model serves."""


@scalar_jit
def climb(
    segments: Any, index: int, load: float, spend: float, flow: float, enough: int, law: Law
) -> tuple[float, float, float, float]:
    """Cost of a tree in which ``index`` has this load and spend, and all above ``flow`` more.

    Walks to the root, or to the first segment of ``enough`` times the flow and on from there by
    the derivatives kept in it (`state.spread_down`). The walk is exact; what is
    left off is of second order in the change there, about 1/enough squared.

    Returns
    -------
    rise : float
        Of the cost K_root.
    by_load, by_spend : float
        Derivatives of the cost with respect to ``load`` and ``spend``.
    radius : float, mm
        Of segment ``index``, as the radius stands of the segment where the walk ended.
    """
    e = 0.25 * law.lam
    # Derivatives of this level's (load, spend) with respect to those at ``index``: a 2 x 2 matrix.
    ll, ls, sl, ss = 1.0, 0.0, 0.0, 1.0
    share = 1.0
    here = index
    much = enough * flow
    while segments[here].parent >= 0 and segments[here].flow < much:
        up = segments[here].parent
        other = segments[up].left
        if other == here:
            other = segments[up].right
        a0 = to_gamma(load, law)
        total, both = a0, spend
        if other >= 0:
            total += to_gamma(segments[other].load, law)
            both += segments[other].spend
        m = from_gamma(total, law)
        mass = (segments[up].flow + flow) * law.k * segments[up].length
        if law.haematocrit >= 0.0:
            mass *= segments[up].thick
        above = mass + m
        me, we = to_lambda(m, law), to_lambda(above, law)
        up_spend = we * (to_u(segments[up].length, law) + both / me)
        m_by_load = (m / total) * (a0 / load)
        spend_by_load = m_by_load * e * (up_spend / above - we * both / (me * m))
        spend_by_spend = we / me
        sl, ss = spend_by_load * ll + spend_by_spend * sl, spend_by_load * ls + spend_by_spend * ss
        ll, ls = m_by_load * ll, m_by_load * ls
        share *= load / m
        load, spend, here = above, up_spend, up
    end = segments[here]
    rise = end.by_load * (load - end.load) + end.by_spend * (spend - end.spend) + flow * end.by_one
    return (
        rise,
        end.by_load * ll + end.by_spend * sl,
        end.by_load * ls + end.by_spend * ss,
        end.radius * sqrt(sqrt(share)),
    )
