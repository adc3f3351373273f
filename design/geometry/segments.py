"""Distances of points, segments and triangles (Ericson, Real-Time Collision Detection, 5.1)."""

from __future__ import annotations

from math import sqrt
from typing import Any, Final

import numpy as np

from kernels import jit, scalar_jit


@jit
def point_segment(
    px: float,
    py: float,
    pz: float,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
) -> tuple[float, float]:
    """Distance of point p from segment ab, and where on it (0 at a, 1 at b).

    A segment of zero length counts as its first end.
    """
    ux, uy, uz = bx - ax, by - ay, bz - az
    length2 = ux * ux + uy * uy + uz * uz
    t = 0.0
    if length2 > 0.0:
        t = ((px - ax) * ux + (py - ay) * uy + (pz - az) * uz) / length2
        t = min(1.0, max(0.0, t))
    dx, dy, dz = ax + t * ux - px, ay + t * uy - py, az + t * uz - pz
    return sqrt(dx * dx + dy * dy + dz * dz), t


@jit
def segment_segment(
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    cx: float,
    cy: float,
    cz: float,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, float, float]:
    """Distance between segments ab and cd, and where on each (0 to 1) it is reached.

    Parallel and zero-length segments included; of several nearest places one is given.
    """
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = dx - cx, dy - cy, dz - cz
    wx, wy, wz = ax - cx, ay - cy, az - cz
    a = ux * ux + uy * uy + uz * uz
    e = vx * vx + vy * vy + vz * vz
    f = vx * wx + vy * wy + vz * wz
    s = 0.0
    t = 0.0
    if a <= 0.0:
        if e > 0.0:
            t = min(1.0, max(0.0, f / e))
    else:
        c = ux * wx + uy * wy + uz * wz
        if e <= 0.0:
            s = min(1.0, max(0.0, -c / a))
        else:
            b = ux * vx + uy * vy + uz * vz
            across = a * e - b * b
            # Below this the lines are parallel to rounding and any s serves.
            if across > 1e-14 * a * e:
                s = min(1.0, max(0.0, (b * f - c * e) / across))
            t = (b * s + f) / e
            if t < 0.0:
                t = 0.0
                s = min(1.0, max(0.0, -c / a))
            elif t > 1.0:
                t = 1.0
                s = min(1.0, max(0.0, (b - c) / a))
    gx = wx + s * ux - t * vx
    gy = wy + s * uy - t * vy
    gz = wz + s * uz - t * vz
    return sqrt(gx * gx + gy * gy + gz * gz), s, t


# Squared distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5).

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
