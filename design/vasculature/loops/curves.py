"""Choose the cheapest Bézier curve between two terminals, clear of all other vessels (compiled)."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from design.vasculature.growth.index import CellIndex
from design.vasculature.loops.curve_fit import (
    Ends,
    Rule,
    point_distance,
    radius_for,
    stations,
    weigh,
)
from kernels import jit

PIECES = 10
"""Straight pieces of a Bézier curve at most."""

_BENDS = 24
"""Places at which a curve's bend is measured."""

_DENSE = 20
"""Steps by which lengths along a curve are measured."""


@jit
def bezier(control: Any, t: float, out: Any) -> None:
    """Point of a cubic Bézier curve with control points (4, 3)."""
    s = 1.0 - t
    a, b, c, d = s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t
    for x in range(3):
        out[x] = a * control[0, x] + b * control[1, x] + c * control[2, x] + d * control[3, x]


@jit
def tightest_bend(control: Any) -> float:
    """Least radius of curvature |B'|³ / |B' x B''| at evenly spaced places, mm."""
    least = np.inf
    one, two = np.empty(3), np.empty(3)
    for n in range(_BENDS + 1):
        t = n / _BENDS
        s = 1.0 - t
        for x in range(3):
            p, q = control[1, x] - control[0, x], control[2, x] - control[1, x]
            r = control[3, x] - control[2, x]
            one[x] = 3.0 * (s * s * p + 2.0 * s * t * q + t * t * r)
            two[x] = 6.0 * (s * (q - p) + t * (r - q))
        speed = sqrt(one[0] ** 2 + one[1] ** 2 + one[2] ** 2)
        across = sqrt(
            (one[1] * two[2] - one[2] * two[1]) ** 2
            + (one[2] * two[0] - one[0] * two[2]) ** 2
            + (one[0] * two[1] - one[1] * two[0]) ** 2
        )
        if across > 1e-12 * speed**3:
            least = min(least, speed**3 / across)
    return least


@jit
def handle(ends: Ends, side: int, shape: Any, control: Any) -> float:
    """Set the inner control point next to one end; return the cosine of the kink there.

    ``shape`` (4,): reach over the chord, lean towards the other end (0 to 1), and two sideways
    parts, all along or across the terminal's direction.
    """
    here, there = ends.point[side], ends.point[1 - side]
    u = ends.direction[side]
    chord = max(point_distance(here, there), 1e-9)
    # Two directions across u, from the axis least along it.
    axis = 0
    for x in range(1, 3):
        if abs(u[x]) < abs(u[axis]):
            axis = x
    j, k = (axis + 1) % 3, (axis + 2) % 3
    first = np.zeros(3)
    size = sqrt(u[j] ** 2 + u[k] ** 2)
    first[j], first[k] = -u[k] / size, u[j] / size
    v = np.empty(3)
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        second = u[y] * first[z] - u[z] * first[y]
        lean = (there[x] - here[x]) / chord
        v[x] = (1.0 - shape[1]) * u[x] + shape[1] * lean + shape[2] * first[x] + shape[3] * second
    size = max(sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2), 1e-9)
    cosine = 0.0
    for x in range(3):
        control[1 + side, x] = here[x] + shape[0] * chord * v[x] / size
        cosine += u[x] * v[x] / size
    return cosine


@jit
def curve_cost(
    ends: Ends,
    shape: Any,
    rule: Rule,
    index: CellIndex,
    capsules: Any,
    until: int,
    best: float,
    points: Any,
) -> tuple[float, float, int]:
    """Cost, radius (mm) and pieces of a candidate; inf where it doesn't fit or costs too much.

    ``shape`` (8,) has `handle`'s four numbers for either end; ``points`` (PIECES + 1, 3)
    receives the polyline. ``until`` and ``best`` as in `weigh`.
    """
    control = np.empty((4, 3))
    control[0], control[3] = ends.point[0], ends.point[1]
    for side in range(2):
        if handle(ends, side, shape[4 * side : 4 * side + 4], control) < rule.straight:
            return np.inf, 0.0, 0
    arc = np.zeros(_DENSE + 1)
    here, there = np.empty(3), np.empty(3)
    here[:] = control[0]
    for n in range(1, _DENSE + 1):
        bezier(control, n / _DENSE, there)
        arc[n] = arc[n - 1] + point_distance(here, there)
        here[:] = there
    bend = tightest_bend(control)
    if rule.by_length * arc[_DENSE] / rule.length >= best or bend < 0.99 * rule.bend * radius_for(
        arc[_DENSE], ends, rule
    ):
        return np.inf, 0.0, 0
    at = np.empty(PIECES + 1)
    count = stations(arc[_DENSE], ends, rule, PIECES, at)
    m = 0
    for n in range(1, count):
        while arc[m + 1] < at[n]:
            m += 1
        t = (m + (at[n] - arc[m]) / (arc[m + 1] - arc[m])) / _DENSE
        bezier(control, t, points[n])
    # The ends exactly: pieces that share a node meet there to the last bit.
    points[0], points[count] = ends.point[0], ends.point[1]
    cost, radius = weigh(ends, points[: count + 1], bend, rule, index, capsules, until, best)
    return cost, radius, count


@jit
def best_curve(
    ends: Ends,
    shapes: Any,
    first: int,
    rule: Rule,
    index: CellIndex,
    capsules: Any,
    until: int,
    points: Any,
) -> tuple[float, int]:
    """Radius (mm) and pieces of the cheapest curve of ``shapes`` (m, 8), or 0 where none fits.

    All of the ``first`` shapes are weighed; where none fits, the others as far as the first
    that does. ``points`` (PIECES + 1, 3) receives its polyline.
    """
    best, best_radius, pieces = np.inf, 0.0, 0
    trial = np.empty((PIECES + 1, 3))
    for n in range(len(shapes)):
        if n >= first and best_radius > 0.0:
            break
        cost, radius, count = curve_cost(ends, shapes[n], rule, index, capsules, until, best, trial)
        if cost < best:
            best, best_radius, pieces = cost, radius, count
            points[:] = trial
    return best_radius, pieces
