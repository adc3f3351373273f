"""Distances point-segment and segment-segment (Ericson, Real-Time Collision Detection, 5.1)."""

from __future__ import annotations

from math import sqrt

from kernels import jit


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
