"""A tree while it grows: one record a segment, its hot fields side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.cost import from_gamma, joined, leaf, to_gamma
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
    ]
)
"""Fields of a growing segment, 128 bytes: two cache lines, the first for the walk to the root.

load, spend : see `design.vasculature.cost`; length : mm; parent, left, right : -1 for none;
terminals : downstream; p and d : ends, mm; radius : of the finished tree as predicted, mm;
allowed : largest radius that tissue and neighbours leave, mm; full : 1 where this segment or one
above it can't grow wider.
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
def spread_radii(segments: Any, count: int, root_radius: float, slack: float, law: Law) -> float:
    """Derive all radii from the root's in one downward pass; mark what is full.

    A segment is full when its radius times ``slack`` exceeds what is allowed, or one above is.

    Returns
    -------
    float
        Smallest radius of a terminal.
    """
    stack = np.empty(count, np.int32)
    stack[0] = 0
    top = 1
    segments[0].radius = root_radius
    segments[0].full = 0
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
        m = from_gamma(to_gamma(a.load, law) + to_gamma(b.load, law), law)
        a.radius = s.radius * np.sqrt(np.sqrt(a.load / m))
        b.radius = s.radius * np.sqrt(np.sqrt(b.load / m))
        a.full = s.full
        b.full = s.full
        stack[top] = s.left
        stack[top + 1] = s.right
        top += 2
    return smallest
