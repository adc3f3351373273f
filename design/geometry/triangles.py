"""Squared distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from design.geometry.segments import point_segment
from kernels import scalar_jit

SLIVER: Final = 1e-14
"""Squared sine of a triangle's angle below which it counts as its edges: what it is beside them
is lost in rounding."""


@scalar_jit
def point_triangle_squared(px: float, py: float, pz: float, tri: Any) -> float:
    """Squared distance of point p from the triangle whose nine coordinates are ``tri`` (9,).

    One without an area counts as its edges, or as the point that it is.
    """
    ax, ay, az = tri[0], tri[1], tri[2]
    abx, aby, abz = tri[3] - ax, tri[4] - ay, tri[5] - az
    acx, acy, acz = tri[6] - ax, tri[7] - ay, tri[8] - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    v = 0.0
    w = 0.0
    if d1 > 0.0 or d2 > 0.0:
        bpx, bpy, bpz = px - tri[3], py - tri[4], pz - tri[5]
        d3 = abx * bpx + aby * bpy + abz * bpz
        d4 = acx * bpx + acy * bpy + acz * bpz
        cpx, cpy, cpz = px - tri[6], py - tri[7], pz - tri[8]
        d5 = abx * cpx + aby * cpy + abz * cpz
        d6 = acx * cpx + acy * cpy + acz * cpz
        vc = d1 * d4 - d3 * d2
        vb = d5 * d2 - d1 * d6
        va = d3 * d6 - d5 * d4
        if d3 >= 0.0 and d4 <= d3:
            v = 1.0
        elif d6 >= 0.0 and d5 <= d6:
            w = 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
            v = d1 / (d1 - d3)
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
            w = d2 / (d2 - d6)
        elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            v = 1.0 - w
        else:
            total = va + vb + vc
            if total <= SLIVER * (d1 - d3) * (d2 - d6):
                return _edges_squared(px, py, pz, tri)
            v = vb / total
            w = vc / total
    gx = apx - v * abx - w * acx
    gy = apy - v * aby - w * acy
    gz = apz - v * abz - w * acz
    return gx * gx + gy * gy + gz * gz


@scalar_jit
def _edges_squared(px: float, py: float, pz: float, tri: Any) -> float:
    best = np.inf
    for edge in range(3):
        i, j = 3 * edge, 3 * ((edge + 1) % 3)
        away, _ = point_segment(
            px, py, pz, tri[i], tri[i + 1], tri[i + 2], tri[j], tri[j + 1], tri[j + 2]
        )
        best = min(best, away)
    return best * best
