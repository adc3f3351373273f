"""Make a tree's radii and its diameter-dependent blood viscosities agree, by iteration."""

from __future__ import annotations

from typing import Any

from design.vasculature.growth.state import refresh_all
from design.vasculature.options import Law
from design.vasculature.viscosity import relative_viscosity
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
