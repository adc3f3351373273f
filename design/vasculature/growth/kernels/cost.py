"""Segment records of a growing tree, and its cost as sums kept on each segment.

The cost of a tree is Σ ℓᵘ r^λ (length, radius).

A segment that feeds terminals of the relative flows q_t has the flow n = Σ q_t, in units of the
mean terminal's; with equal terminal flows n is their number. Of the quantities of Karch et al.
1999 (R*, C*, the ratios β) these two are kept for each segment:

- weighted resistance  W = n R*
- cost sum  K = W^(λ/4) C*

Put into R* = 8μℓ/π + 1/(β_l⁴/R*_l + β_r⁴/R*_r) with β_l = (1 + x^-γ)^(-1/γ) and
x = (n_l R*_l / n_r R*_r)^¼ = (W_l/W_r)^¼, the bifurcation's algebra shrinks to

- m = (W_l^(γ/4) + W_r^(γ/4))^(4/γ), the weighted resistance of both children together
- W = n k v ℓ + m, with k = 8μ/π; a terminal's is q k v ℓ
- β_l⁴ = W_l / m
- K = W^(λ/4) (ℓᵘ + (K_l + K_r) / m^(λ/4))

because n_l + n_r = n and β_l⁴/R*_l = n_l / m. At the root r⁴ = Q R*/Δp = (Q/n) W/Δp, so the
cost r_root^λ C*_root is K_root times a constant: growth compares K_root alone.

v is the segment's viscosity over μ: 1 for a Newtonian fluid, else what
`viscosity` gives for its radius. Where a segment has one child alone (a bend of a given trunk), m
is the child's W.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.kernels.bifurcation import join_children, leaf
from design.vasculature.growth.kernels.flow_laws import from_gamma, to_gamma, to_lambda
from design.vasculature.options import Law
from design.vasculature.viscosity import ROUNDS, SETTLED, relative_viscosity
from kernels import jit, scalar_jit

SEGMENT = np.dtype(
    [
        ("weighted_resistance", "f8"),
        ("cost_sum", "f8"),
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
        ("by_resistance", "f8"),
        ("by_cost_sum", "f8"),
        ("by_one", "f8"),
        ("relative_viscosity", "f8"),
        ("audited", "f8"),
    ]
)
"""Fields of a growing segment.

weighted_resistance, cost_sum : see above; length : mm; flow : over the mean terminal's; parent,
left, right : -1 for none (right alone where a given trunk bends); terminals : downstream, 0 for a
vessel of another tree (kept behind all the tree's own); p and d : ends, mm; radius : of the
finished tree as predicted, mm; allowed : largest radius that tissue and neighbours leave, mm;
full : 1 where this segment or one above it can't grow wider; given : `TRUNK` or `PLANNED` for a
segment that stays where it is, else 0; by_* : derivatives of the cost; relative_viscosity :
viscosity over μ, read only where the law has a haematocrit; audited : radius with which a large
tree's audit measured what it is allowed, mm, 0 where it hasn't been (`growth.regions`).
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
    return s.flow * s.relative_viscosity


@scalar_jit
def refresh(segments: Any, i: int, law: Law) -> None:
    """Recompute a segment's weighted resistance, cost sum, flow and terminals from its children's.

    A terminal's flow is its own, and stays.
    """
    s = segments[i]
    if s.left < 0:
        s.terminals = 1
        s.weighted_resistance, s.cost_sum = leaf(s.length, weight_of(s, law), law)
        return
    a = segments[s.left]
    terminals, flow, resistance1, cost_sum1 = a.terminals, a.flow, 0.0, 0.0
    if s.right >= 0:
        b = segments[s.right]
        terminals += b.terminals
        flow += b.flow
        resistance1, cost_sum1 = b.weighted_resistance, b.cost_sum
    s.terminals, s.flow = terminals, flow
    resistance, cost_sum, _ = join_children(
        a.weighted_resistance, a.cost_sum, resistance1, cost_sum1, s.length, weight_of(s, law), law
    )
    s.weighted_resistance, s.cost_sum = resistance, cost_sum


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
    root.by_resistance, root.by_cost_sum, root.by_one = 0.0, 1.0, 0.0
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
        in_a, in_b, cost_sums = to_gamma(a.weighted_resistance, law), 0.0, a.cost_sum
        if s.right >= 0:
            in_b = to_gamma(segments[s.right].weighted_resistance, law)
            cost_sums += segments[s.right].cost_sum
        m = from_gamma(in_a + in_b, law)
        m_e, s_e = to_lambda(m, law), to_lambda(s.weighted_resistance, law)
        own = e * s.cost_sum / s.weighted_resistance
        by_m = s.by_resistance + s.by_cost_sum * (own - e * s_e * cost_sums / (m_e * m))
        by_one = law.k * s.length * (s.by_resistance + s.by_cost_sum * own)
        if law.haematocrit >= 0.0:
            by_one *= s.relative_viscosity
        by_one += s.by_one
        for which, part in ((s.left, in_a), (s.right, in_b)):
            if which < 0:
                continue
            child = segments[which]
            child.radius = s.radius * np.sqrt(np.sqrt(child.weighted_resistance / m))
            child.full = s.full
            child.by_resistance = by_m * (m / (in_a + in_b)) * (part / child.weighted_resistance)
            child.by_cost_sum = s.by_cost_sum * s_e / m_e
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


@jit
def depth_first(segments: Any, count: int) -> Any:
    """Renumber segments so that each is followed by its branch; a copy of the array."""
    order = np.empty(count, np.int32)
    number = np.full(count + 1, -1, np.int32)
    stack = np.empty(count, np.int32)
    stack[0] = 0
    top = 1
    size = 0
    while top > 0:
        top -= 1
        i = stack[top]
        order[size] = i
        number[i] = size
        size += 1
        if segments[i].left >= 0:
            if segments[i].right >= 0:
                stack[top] = segments[i].right
                top += 1
            stack[top] = segments[i].left
            top += 1
    result = segments.copy()
    for n in range(count):
        result[n] = segments[order[n]]
        s = result[n]
        # number[-1] is -1: no parent, no child.
        s.parent, s.left, s.right = number[s.parent], number[s.left], number[s.right]
    return result


@jit
def drop_marked(segments: Any, count: int, gone: Any) -> int:
    """Close the gaps of segments that are gone; return the new count."""
    number = np.full(count + 1, -1, np.int32)
    size = 0
    for i in range(count):
        if gone[i] == 0:
            number[i] = size
            size += 1
    for i in range(count):
        if gone[i] == 0:
            s = segments[i]
            # number[-1] is -1: no parent, no child.
            s.parent, s.left, s.right = number[s.parent], number[s.left], number[s.right]
            segments[number[i]] = s
    return size


EXACT_FLOW_RATIO = 64
"""Flow, over that of a new terminal, above which this one changes a segment so little that the
linear model serves."""


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
        viscosity = relative_viscosity(s.radius, law.haematocrit)
        change = max(change, abs(viscosity / s.relative_viscosity - 1.0))
        s.relative_viscosity = viscosity
        if s.left < 0:
            total += viscosity
            tips += 1
    refresh_all(segments, count, law)
    return change, total / tips


def settle_radii(
    segments: Segments,
    count: int,
    law: Law,
    root_radius: float,
    flow_over_drop: float,
    smallest: float | None,
) -> None:
    """Derive radii by the pressure drop, or as wide as the smallest radius asks for.

    Parameters
    ----------
    root_radius : float, mm
        Of the root, or 0 where ``flow_over_drop`` (µL/s/Pa) sets it.
    smallest : float, mm, optional
        No terminal stays wider than this.
    """
    top = segments[0]
    for _ in range(ROUNDS):
        root = root_radius or float(
            (flow_over_drop * float(top["weighted_resistance"]) / float(top["flow"])) ** 0.25
        )
        thinnest = spread_down(segments, count, root, 1.0, law)
        if smallest is not None and thinnest > smallest:
            spread_down(segments, count, root * (smallest / thinnest), 1.0, law)
        if law.haematocrit < 0.0 or follow_radii(segments, count, law)[0] < SETTLED:
            return
