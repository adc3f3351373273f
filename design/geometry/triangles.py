"""Distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5)."""

from __future__ import annotations

from typing import Any

from kernels import jit


@jit
def point_triangle_squared(px: float, py: float, pz: float, tri: Any) -> float:
    """Squared distance of point p from the triangle whose nine coordinates are ``tri`` (9,)."""
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
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            v = d1 / (d1 - d3)
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            w = d2 / (d2 - d6)
        elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            v = 1.0 - w
        else:
            total = va + vb + vc
            v = vb / total
            w = vc / total
    gx = apx - v * abx - w * acx
    gy = apy - v * aby - w * acy
    gz = apz - v * abz - w * acz
    return gx * gx + gy * gy + gz * gz
