"""Segment records of a growing tree: sum flow and cost towards the root, radii from the root."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.cost import from_gamma, joined_load, leaf, to_gamma, to_lambda
from design.vasculature.options import Law
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

load, spend : see `growth.cost`; length : mm; flow : over the mean terminal's; parent,
left, right : -1 for none (right alone where a given trunk bends); terminals : downstream, 0 for a
vessel of another tree (kept behind all the tree's own); p and d : ends, mm; radius : of the
finished tree as predicted, mm; allowed : largest radius that tissue and neighbours leave, mm;
full : 1 where this segment or one above it can't grow wider; given : `TRUNK` or `PLANNED` for a
segment that stays where it is, else 0; by_* : derivatives of the cost; thick : viscosity over μ,
read only where the law has a haematocrit; audited : radius with which a large tree's audit measured
its room, mm, 0 where it hasn't been (`growth.regions.audit`).
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
