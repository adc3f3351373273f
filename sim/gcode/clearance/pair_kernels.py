"""Kernel: clearance between a moving shaft and a written filament, excluding joints.

A shaft S with its tip at the origin is a body of revolution about the upward axis. Its signed
distance d_S (negative inside) is a 1-Lipschitz function of place. With the tip at b(s) on a move
and the filament's axis at a(t), radius r(t), both linear, the approach is

    g(s, t) = d_S(a(t) - b(s)) - r(t),

whose minimum over 0 <= s, t <= 1 is the nearest approach of the swept shaft to the filament, a
union of balls. |dg/ds| is at most the move's length and |dg/dt| the filament's plus |r1 - r0|. So a
rectangle of s and t with half sides hs and ht holds nothing below its middle's g less those slopes
times hs and ht: `pair_approach` cuts rectangles in half and drops those that can't lie below what
is found already. What it returns is attained, and not above the true minimum by more than
`ERROR_MM` (or `ERROR_SHARE` of it, where that is more). A joint's border is found within
`DECIDING_ERROR_MM` of arc length in the same way, since its slack is Lipschitz, too.
"""

from __future__ import annotations

from typing import Final

from kernels import jit
from kernels.arrays import FloatArray
from sim.gcode.clearance.bodies import Ink, Joints, Tips
from sim.gcode.clearance.joint_kernels import ink_slope, slack_of, tip_slope
from sim.gcode.clearance.shaft_kernels import approach, span

ERROR_MM: Final = 0.002
ERROR_SHARE: Final = 0.05
DECIDING_MM: Final = 0.02
DECIDING_ERROR_MM: Final = 0.0005
"""So small an error where the shaft is no deeper in ink than the first: there it decides what
crosses."""


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
    i, j : int
    limit : float, mm
        What is asked is an approach below it.
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
        error = max(ERROR_MM, ERROR_SHARE * best)
        if -DECIDING_MM < best < 0.0:
            error = DECIDING_ERROR_MM
        if value - hs * move - ht * fall >= best - error:
            continue
        if joined:
            slack, margin = slack_of(i, j, s, t, tips, ink, joints), hs * by_s + ht * by_t
            if slack > margin:
                continue
            if slack > 0.0 and margin <= DECIDING_ERROR_MM:
                continue
            if slack <= 0.0 and value < best:
                best, best_s, best_t = value, s, t
        elif value < best:
            best, best_s, best_t = value, s, t
        if hs * by_s + ht * by_t <= 0.25 * DECIDING_ERROR_MM:
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
