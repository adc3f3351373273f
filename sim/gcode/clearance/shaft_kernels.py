"""Distance between a vertical needle shaft and a filament (compiled)."""

from __future__ import annotations

import numpy as np

from kernels import jit
from kernels.arrays import FloatArray
from sim.gcode.clearance.bodies import Ink, Tips


@jit
def span(a: FloatArray, b: FloatArray) -> float:
    """Distance of two places, mm; spelt out, which compiles faster than array arithmetic."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return float(np.sqrt(x * x + y * y + z * z))


@jit
def shaft_distance(x: float, y: float, z: float, body: FloatArray) -> float:
    """Signed distance of a place, from the tip, to the shaft, mm; negative inside.

    ``body`` is `NeedleBody.as_row`: radius, tip's radius, cone's height, length, hub's radius. In
    the half plane of radius and height the shaft (without hub) is convex: above 0, within the
    shaft's radius, within the cone's slant.
    """
    rho = np.sqrt(x * x + y * y)
    wide, tip, cone = body[0], body[1], body[2]
    if cone <= 0.0:
        out = _corner(rho - wide, -z)
    else:
        slant = np.sqrt(cone * cone + (wide - tip) ** 2)
        across = ((rho - tip) * cone - z * (wide - tip)) / slant
        inside = max(-z, rho - wide, across)
        if inside <= 0.0:
            out = inside
        else:
            # Nearest of tip's disc, slant and shaft.
            share = ((rho - tip) * (wide - tip) + z * cone) / (slant * slant)
            share = min(max(share, 0.0), 1.0)
            off, up = rho - tip - share * (wide - tip), z - share * cone
            square = off * off + up * up
            square = min(square, max(rho - tip, 0.0) ** 2 + z * z)
            square = min(square, (rho - wide) ** 2 + min(z - cone, 0.0) ** 2)
            out = np.sqrt(square)
    if body[3] < np.inf:
        out = min(out, _corner(rho - body[4], body[3] - z))
    return float(out)


@jit
def _corner(a: float, b: float) -> float:
    """Signed distance to a quadrant, from those to its two sides."""
    if a <= 0.0 or b <= 0.0:
        return float(max(a, b))
    return float(np.sqrt(a * a + b * b))


@jit
def approach(i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, body: FloatArray) -> float:
    """g(s, t) of piece of motion i and of ink j, mm."""
    a, b, c, d = ink.start[j], ink.end[j], tips.start[i], tips.end[i]
    x = a[0] + t * (b[0] - a[0]) - c[0] - s * (d[0] - c[0])
    y = a[1] + t * (b[1] - a[1]) - c[1] - s * (d[1] - c[1])
    z = a[2] + t * (b[2] - a[2]) - c[2] - s * (d[2] - c[2])
    radius = ink.radius[j, 0] + t * (ink.radius[j, 1] - ink.radius[j, 0])
    return float(shaft_distance(x, y, z, body) - radius)
