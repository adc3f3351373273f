"""Smooth a route to a cubic B-spline, relaxed as far as clearances allow (compiled)."""

from __future__ import annotations

from math import acos
from typing import Any

import numpy as np

from design.vasculature.growth.kernels.index import CellIndex
from design.vasculature.loops.curves import (
    CURVE,
    ConnectionLimits,
    Ends,
    bezier,
    heading,
    piece_clear,
    point_distance,
    radius_for,
    tightest_bend,
)
from design.vasculature.loops.settings import SPLINE
from kernels import jit


@jit
def span(control: Any, i: int, out: Any) -> None:
    """Write the Bézier control points (4, 3) of the B-spline's part between controls i and i + 1.

    Beyond an end the controls go on as mirrored at it, so that the curve passes through its ends
    along the first and last leg without curvature.
    """
    last = len(control) - 1
    for x in range(3):
        q, r = control[i, x], control[i + 1, x]
        p = control[i - 1, x] if i > 0 else 2.0 * q - r
        s = control[i + 2, x] if i + 1 < last else 2.0 * r - q
        out[0, x] = (p + 4.0 * q + r) / 6.0
        out[1, x] = (2.0 * q + r) / 3.0
        out[2, x] = (q + 2.0 * r) / 3.0
        out[3, x] = (q + 4.0 * r + s) / 6.0


@jit
def spline_points(
    control: Any, ends: Ends, limits: ConnectionLimits, most: int, points: Any
) -> tuple[int, float]:
    """Write a spline's polyline; return its pieces, at most ``most``, and least bend, mm.

    A piece ends where the curve has turned by ``max_turn`` since it began, or gets too long; but
    it has the least length that separates the pieces before and after it (see `stations`).
    """
    dense = (len(control) - 1) * SPLINE.points_per_span + 1
    line, arc = np.empty((dense, 3)), np.zeros(dense)
    part = np.empty((4, 3))
    bend = np.inf
    line[0] = ends.point[0]
    for n in range(1, dense):
        i, m = divmod(n - 1, SPLINE.points_per_span)
        span(control, i, part)
        if m == 0:
            bend = min(bend, tightest_bend(part))
        bezier(part, (m + 1) / SPLINE.points_per_span, line[n])
        arc[n] = arc[n - 1] + point_distance(line[n - 1], line[n])
    length = arc[dense - 1]
    radius = radius_for(length, ends, limits)
    kept = max(limits.clearance, limits.ratio * radius)
    shortest = CURVE.separation * (radius + ends.radius[0] + kept)
    last = CURVE.separation * (radius + ends.radius[1] + kept)
    longest = max(1.5 * length / most, SPLINE.max_length * radius)
    count, begun, turn = 0, 0.0, 0.0
    points[0] = ends.point[0]
    for n in range(1, dense - 1):
        turn += turning(line[n - 1], line[n], line[n + 1])
        size = arc[n] - begun
        if length - arc[n] < last or count == most - 1:
            break
        if size >= shortest and (turn >= SPLINE.max_turn or size + arc[n + 1] - arc[n] > longest):
            count += 1
            points[count] = line[n]
            begun, turn = arc[n], 0.0
            shortest = CURVE.separation * (2.0 * radius + kept)
    count += 1
    points[count] = ends.point[1]
    return count, bend


@jit
def turning(a: Any, b: Any, c: Any) -> float:
    """Return the angle between the ways from a to b and from b to c, radians."""
    dot = 0.0
    for x in range(3):
        dot += (b[x] - a[x]) * (c[x] - b[x])
    return acos(max(-1.0, min(1.0, dot / max(point_distance(a, b) * point_distance(b, c), 1e-300))))


@jit
def spans_clear(
    control: Any,
    first: int,
    last: int,
    arc: Any,
    ends: Ends,
    radius: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> bool:
    """Return whether spans ``first`` to ``last`` are in the tissue and clear of all vessels."""
    part = np.empty((4, 3))
    here, there = np.empty(3), np.empty(3)
    length = arc[len(control) - 1]
    for i in range(max(first, 0), min(last, len(control) - 2) + 1):
        span(control, i, part)
        here[:] = part[0]
        for n in range(SPLINE.checks_per_span):
            bezier(part, (n + 1) / SPLINE.checks_per_span, there)
            step = (arc[i + 1] - arc[i]) / SPLINE.checks_per_span
            gone = arc[i] + n * step
            left = length - gone - step
            ease = 1.0 + min(gone, left) / (SPLINE.narrowing * radius)
            wide = radius * min(SPLINE.widening, ease)
            if not piece_clear(ends, here, there, gone, left, wide, limits, index, capsules):
                return False
            here[:] = there
    return True


@jit
def relax(
    control: Any,
    sweeps: int,
    ends: Ends,
    radius: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> None:
    """Draw each inner control towards its neighbours' middle, as far as its spans stay clear."""
    last = len(control) - 1
    arc = np.zeros(last + 1)
    kept = np.empty(3)
    for _ in range(sweeps):
        for n in range(last):
            arc[n + 1] = arc[n] + point_distance(control[n], control[n + 1])
        for i in range(1, last):
            kept[:] = control[i]
            for part in (0.8, 0.3):
                for x in range(3):
                    middle = 0.5 * (control[i - 1, x] + control[i + 1, x])
                    control[i, x] = kept[x] + part * (middle - kept[x])
                turned = (
                    i == 1 and heading(ends, 0, control[0], control[1]) < limits.min_cosine
                ) or (
                    i == last - 1
                    and heading(ends, 1, control[last], control[last - 1]) < limits.min_cosine
                )
                if not turned and spans_clear(
                    control, i - 2, i + 1, arc, ends, radius, limits, index, capsules
                ):
                    break
                control[i] = kept
