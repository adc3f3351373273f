"""Segment records of a growing tree: sum flow and cost towards the root, radii from the root."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.vasculature.options import Law
from design.vasculature.viscosity import relative_viscosity
from kernels import jit, scalar_jit

SEGMENT = np.dtype(
    [
        ("load", "f8"),
        ("spend", "f8"),
        ("length", "f8"),
        ("flow", "f8"),
        ("parent", "i4"),
        ("left", "i4"),
        ("right", "i4"),
        ("terminals", "i4"),
        ("px", "f8"),
        ("py", "f8"),
        ("pz", "f8"),
        ("dx", "f8"),
        ("dy", "f8"),
        ("dz", "f8"),
        ("radius", "f8"),
        ("allowed", "f8"),
        ("full", "i4"),
        ("given", "i4"),
        ("by_load", "f8"),
        ("by_spend", "f8"),
        ("by_one", "f8"),
        ("thick", "f8"),
        ("audited", "f8"),
    ]
)
"""Fields of a growing segment.

load, spend : see `tree_cost` below; length : mm; flow : over the mean terminal's; parent,
left, right : -1 for none (right alone where a given trunk bends); terminals : downstream, 0 for a
vessel of another tree (kept behind all the tree's own); p and d : ends, mm; radius : of the
finished tree as predicted, mm; allowed : largest radius that tissue and neighbours leave, mm;
full : 1 where this segment or one above it can't grow wider; given : `TRUNK` or `PLANNED` for a
segment that stays where it is, else 0; by_* : derivatives of the cost; thick : viscosity over μ,
read only where the law has a haematocrit; audited : radius with which a large tree's audit measured
its room, mm, 0 where it hasn't been (`growth.regions`).
"""
Segments = NDArray[np.void]
TRUNK, PLANNED = 1, 2
"""What is given: a trunk's segment, or one of a branch planned to leave it."""


@scalar_jit
def place(segments: Any, i: int, p: Any, d: Any) -> None:
    """Set a segment's ends, and its length."""
    s = segments[i]
    s.px, s.py, s.pz = p
    s.dx, s.dy, s.dz = d
    x, y, z = d[0] - p[0], d[1] - p[1], d[2] - p[2]
    s.length = np.sqrt(x * x + y * y + z * z)


@jit
def weight_of(s: Any, law: Law) -> float:
    """A segment's flow times its viscosity over μ."""
    if law.haematocrit < 0.0:
        return s.flow
    return s.flow * s.thick


@scalar_jit
def refresh(segments: Any, i: int, law: Law) -> None:
    """Recompute a segment's load, spend, flow and terminals from its children's.

    A terminal's flow is its own, and stays.
    """
    s = segments[i]
    if s.left < 0:
        s.terminals = 1
        s.load, s.spend = leaf(s.length, weight_of(s, law), law)
        return
    a = segments[s.left]
    terminals, flow, load1, spend1 = a.terminals, a.flow, 0.0, 0.0
    if s.right >= 0:
        b = segments[s.right]
        terminals += b.terminals
        flow += b.flow
        load1, spend1 = b.load, b.spend
    s.terminals, s.flow = terminals, flow
    load, spend, _ = joined_load(a.load, a.spend, load1, spend1, s.length, weight_of(s, law), law)
    s.load, s.spend = load, spend


@scalar_jit
def refresh_upwards(segments: Any, i: int, law: Law) -> None:
    """Recompute segment ``i`` and all above it."""
    while i >= 0:
        refresh(segments, i, law)
        i = segments[i].parent


@jit
def spread_down(segments: Any, count: int, root_radius: float, slack: float, law: Law) -> float:
    """Derive all radii and all derivatives of the cost from the root's, in one downward pass.

    A segment is full when its radius times ``slack`` exceeds what is allowed, or one above is.

    Returns
    -------
    float
        Smallest radius of a terminal.
    """
    e = 0.25 * law.lam
    stack = np.empty(count, np.int32)
    stack[0] = 0
    top = 1
    root = segments[0]
    root.radius, root.full = root_radius, 0
    root.by_load, root.by_spend, root.by_one = 0.0, 1.0, 0.0
    smallest = np.inf
    while top > 0:
        top -= 1
        i = stack[top]
        s = segments[i]
        if s.radius * slack > s.allowed:
            s.full = 1
        if s.left < 0:
            smallest = min(smallest, s.radius)
            continue
        a = segments[s.left]
        # As in `climb`, from the other end.
        in_a, in_b, spends = to_gamma(a.load, law), 0.0, a.spend
        if s.right >= 0:
            in_b = to_gamma(segments[s.right].load, law)
            spends += segments[s.right].spend
        m = from_gamma(in_a + in_b, law)
        m_e, s_e = to_lambda(m, law), to_lambda(s.load, law)
        own = e * s.spend / s.load
        by_m = s.by_load + s.by_spend * (own - e * s_e * spends / (m_e * m))
        by_one = law.k * s.length * (s.by_load + s.by_spend * own)
        if law.haematocrit >= 0.0:
            by_one *= s.thick
        by_one += s.by_one
        for which, part in ((s.left, in_a), (s.right, in_b)):
            if which < 0:
                continue
            child = segments[which]
            child.radius = s.radius * np.sqrt(np.sqrt(child.load / m))
            child.full = s.full
            child.by_load = by_m * (m / (in_a + in_b)) * (part / child.load)
            child.by_spend = s.by_spend * s_e / m_e
            child.by_one = by_one
        stack[top] = s.left
        top += 1
        if s.right >= 0:
            stack[top] = s.right
            top += 1
    return smallest


@jit
def bottom_up(segments: Any, count: int) -> Any:
    """Segments in an order in which children come before their parents, (n,) int32."""
    order = np.empty(count, np.int32)
    stack = np.empty(count, np.int32)
    stack[0] = 0
    top = 1
    size = 0
    while top > 0:
        top -= 1
        s = segments[stack[top]]
        order[size] = stack[top]
        size += 1
        for child in (s.left, s.right):
            if child >= 0:
                stack[top] = child
                top += 1
    return order[:size][::-1].copy()


@jit
def refresh_all(segments: Any, count: int, law: Law) -> None:
    """Recompute every segment from the terminals up."""
    for i in bottom_up(segments, count):
        refresh(segments, i, law)


# Compute a tree's cost Σ ℓᵘ r^λ (length, radius) from sums per segment, updated as it grows.
#
# A segment that feeds terminals of the relative flows q_t has the flow n = Σ q_t, in units of the
# mean terminal's; with equal terminal flows n is their number. Of the quantities of Karch et al.
# 1999 (R\*, C\*, the ratios β) these two are kept for each segment:
#
# - load   W = n R\*
# - spend  K = W^(λ/4) C\*
#
# Put into R\* = 8μℓ/π + 1/(β_l⁴/R\*_l + β_r⁴/R\*_r) with β_l = (1 + x^-γ)^(-1/γ) and
# x = (n_l R\*_l / n_r R\*_r)^¼ = (W_l/W_r)^¼, the bifurcation's algebra shrinks to
#
# - m = (W_l^(γ/4) + W_r^(γ/4))^(4/γ), the load of both children together
# - W = n k v ℓ + m, with k = 8μ/π; a terminal's is q k v ℓ
# - β_l⁴ = W_l / m
# - K = W^(λ/4) (ℓᵘ + (K_l + K_r) / m^(λ/4))
#
# because n_l + n_r = n and β_l⁴/R\*_l = n_l / m. At the root r⁴ = Q R\*/Δp = (Q/n) W/Δp, so the
# cost r_root^λ C\*_root is K_root times a constant: growth compares K_root alone.
#
# v is the segment's viscosity over μ: 1 for a Newtonian fluid, else what
# `viscosity` gives for its radius. Where a segment has one child alone (a bend of a given trunk), m
# is the child's W.


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


@jit
def follow_radii(segments: Any, count: int, law: Law) -> tuple[float, float]:
    """Take every segment's viscosity at its radius, and recompute the tree.

    Returns
    -------
    float, float
        Largest relative change; mean viscosity of the terminals, over μ.
    """
    change, total, tips = 0.0, 0.0, 0
    for i in range(count):
        s = segments[i]
        thick = relative_viscosity(s.radius, law.haematocrit)
        change = max(change, abs(thick / s.thick - 1.0))
        s.thick = thick
        if s.left < 0:
            total += thick
            tips += 1
    refresh_all(segments, count, law)
    return change, total / tips
