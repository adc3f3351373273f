"""A tree while it grows: one record a segment, its hot fields side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.cost import from_gamma, joined, leaf, to_gamma, to_lambda
from design.vasculature.options import Law
from kernels import jit

SEGMENT = np.dtype(
    [
        ("load", "f8"),
        ("spend", "f8"),
        ("length", "f8"),
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
        ("full", "i8"),
        ("by_load", "f8"),
        ("by_spend", "f8"),
        ("by_one", "f8"),
    ]
)
"""Fields of a growing segment.

load, spend : see `design.vasculature.cost`; length : mm; parent, left, right : -1 for none;
terminals : downstream, 0 for a vessel of another tree (kept behind all the tree's own);
p and d : ends, mm; radius : of the finished tree as predicted, mm; allowed : largest radius that
tissue and neighbours leave, mm; full : 1 where this segment or one above it can't grow wider.
"""

Segments = NDArray[np.void]


@jit
def place(segments: Any, i: int, p: Any, d: Any) -> None:
    """Set a segment's ends, and its length."""
    s = segments[i]
    s.px, s.py, s.pz = p
    s.dx, s.dy, s.dz = d
    x, y, z = d[0] - p[0], d[1] - p[1], d[2] - p[2]
    s.length = np.sqrt(x * x + y * y + z * z)


@jit
def refresh(segments: Any, i: int, law: Law) -> None:
    """Recompute a segment's load, spend and terminals from its children's."""
    s = segments[i]
    if s.left < 0:
        s.terminals = 1
        s.load, s.spend = leaf(s.length, law)
        return
    a, b = segments[s.left], segments[s.right]
    s.terminals = a.terminals + b.terminals
    load, spend, _ = joined(a.load, a.spend, b.load, b.spend, s.length, s.terminals, law)
    s.load, s.spend = load, spend


@jit
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
        a, b = segments[s.left], segments[s.right]
        # As in `climb`, from the other end.
        in_a, in_b = to_gamma(a.load, law), to_gamma(b.load, law)
        m = from_gamma(in_a + in_b, law)
        m_e, s_e = to_lambda(m, law), to_lambda(s.load, law)
        own = e * s.spend / s.load
        by_m = s.by_load + s.by_spend * (own - e * s_e * (a.spend + b.spend) / (m_e * m))
        by_one = s.by_one + law.k * s.length * (s.by_load + s.by_spend * own)
        for child, part in ((a, in_a), (b, in_b)):
            child.radius = s.radius * np.sqrt(np.sqrt(child.load / m))
            child.full = s.full
            child.by_load = by_m * (m / (in_a + in_b)) * (part / child.load)
            child.by_spend = s.by_spend * s_e / m_e
            child.by_one = by_one
        stack[top] = s.left
        stack[top + 1] = s.right
        top += 2
    return smallest
