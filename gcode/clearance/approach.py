"""Kernel: clearance between a moving shaft and a written filament, excluding joints.

A shaft S with its tip at the origin is a body of revolution about the upward axis. Its signed
distance d_S (negative inside) is a 1-Lipschitz function of place. With the tip at b(s) on a move
and the filament's axis at a(t), radius r(t), both linear, the approach is

g(s, t) = d_S(a(t) - b(s)) - r(t),

whose minimum over 0 <= s, t <= 1 is the nearest approach of the swept shaft to the filament, a
union of balls. |dg/ds| is at most the move's length and |dg/dt| the filament's plus |r1 - r0|. So
a rectangle of s and t with half sides hs and ht holds nothing below its middle's g less those
slopes times hs and ht: `pair_approach` cuts rectangles in half and drops those that can't lie
below what is found already. What it returns is attained, and not above the true minimum by more
than `error_mm` (or `error_share` of it, where that is more). A joint's border is found within
`deciding_error_mm` of arc length in the same way, since its slack is Lipschitz, too.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from gcode.clearance.arrays import Ink, Joints, Tips
from gcode.clearance.joints import ink_slope, slack_of, tip_slope
from kernels import jit
from kernels.arrays import FloatArray


class SearchAccuracy(NamedTuple):
    """Accuracy of the shaft search."""

    error_mm: float = 0.002
    error_share: float = 0.05
    deciding_mm: float = 0.02
    # So small an error where the shaft is no deeper in ink than the first: there it decides what
    # crosses.
    deciding_error_mm: float = 0.0005


SEARCH: Final = SearchAccuracy()


@jit
def pair_approach(
    i: int,
    j: int,
    limit: float,
    joined: bool,
    tips: Tips,
    ink: Ink,
    joints: Joints,
    body: FloatArray,
    stack: FloatArray,
) -> tuple[float, float, float]:
    """Nearest approach of a piece of motion to a piece of ink outside joints.

    Parameters
    ----------
    limit : float, mm
        Only an approach below it counts.
    joined : bool
        As `related` says.
    stack : (64, 4) float64
        Scratch space.

    Returns
    -------
    value : float, mm
        ``limit`` where there is none.
    s, t : float
        Where, as shares of the two pieces.
    """
    best, best_s, best_t = limit, -1.0, -1.0
    move = span(tips.start[i], tips.end[i])
    way = span(ink.start[j], ink.end[j])
    fall = way + abs(ink.radius[j, 1] - ink.radius[j, 0])
    by_s = max(move, tip_slope(i, tips)) if joined else move
    by_t = max(fall, ink_slope(j, ink)) if joined else fall
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0.0, 1.0, 0.0, 1.0
    count = 1
    while count > 0:
        count -= 1
        s0, s1, t0, t1 = stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3]
        s, t, hs, ht = 0.5 * (s0 + s1), 0.5 * (t0 + t1), 0.5 * (s1 - s0), 0.5 * (t1 - t0)
        value = approach(i, j, s, t, tips, ink, body)
        error = max(SEARCH.error_mm, SEARCH.error_share * best)
        if -SEARCH.deciding_mm < best < 0.0:
            error = SEARCH.deciding_error_mm
        if value - hs * move - ht * fall >= best - error:
            continue
        if joined:
            slack, margin = slack_of(i, j, s, t, tips, ink, joints), hs * by_s + ht * by_t
            if slack > margin:
                continue
            if slack > 0.0 and margin <= SEARCH.deciding_error_mm:
                continue
            if slack <= 0.0 and value < best:
                best, best_s, best_t = value, s, t
        elif value < best:
            best, best_s, best_t = value, s, t
        if hs * by_s + ht * by_t <= 0.25 * SEARCH.deciding_error_mm:
            continue
        if hs * by_s >= ht * by_t:
            stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3] = s0, s, t0, t1
            stack[count + 1, 0], stack[count + 1, 1] = s, s1
            stack[count + 1, 2], stack[count + 1, 3] = t0, t1
        else:
            stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3] = s0, s1, t0, t
            stack[count + 1, 0], stack[count + 1, 1] = s0, s1
            stack[count + 1, 2], stack[count + 1, 3] = t, t1
        count += 2
    return best, best_s, best_t


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
