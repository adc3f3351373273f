"""Make a tree's radii and its diameter-dependent blood viscosities agree, by iteration."""

from __future__ import annotations

from math import sqrt
from typing import Any

from design.vasculature.growth.state import refresh_all, spread_down
from design.vasculature.options import Law
from design.vasculature.viscosity import ROUNDS, SETTLED, relative_viscosity
from kernels import jit


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


@jit
def settle_root(segments: Any, count: int, flow_over_drop: float, slack: float, law: Law) -> float:
    """Radii by the pressure drop, in one pass or until viscosities and radii agree.

    Returns the smallest radius of a terminal.
    """
    smallest = 0.0
    for _ in range(ROUNDS):
        root = sqrt(sqrt(flow_over_drop * segments[0].load / segments[0].flow))
        smallest = spread_down(segments, count, root, slack, law)
        if law.haematocrit < 0.0 or follow_radii(segments, count, law)[0] < SETTLED:
            break
    return smallest
