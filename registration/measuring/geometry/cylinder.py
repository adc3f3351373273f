"""Cylindricity: width of the thinnest cylindrical shell around points."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from design.geometry.polyline import vectors_across
from kernels.arrays import FloatArray

_STEPS = 2
_FIRST = 50
"""Points farthest out and farthest in that the first programme holds."""


def minimum_zone(points: FloatArray, middle: FloatArray, direction: FloatArray) -> float:
    """Difference of the radii of two coaxial cylinders that hold points (n, 3) between them, mm.

    The least there is near the given axis (ISO 1101:2017, 17.6; minimum zone): radii linear in a
    small shift and tilt of the axis make it a linear programme, solved again about each answer.
    Points are added until none lies outside the zone.
    """
    centre, axis = np.array(middle, dtype=np.float64), _unit(direction)
    for _ in range(_STEPS):
        side, other = vectors_across(axis)
        away = points - centre
        along, x, y = away @ axis, away @ side, away @ other
        step = _programme(along, x, y)
        centre = centre + step[0] * side + step[1] * other
        axis = _unit(axis + step[2] * side + step[3] * other)
    away = points - centre
    radius = np.linalg.norm(away - (away @ axis)[:, None] * axis, axis=1)
    return float(np.ptp(radius))


def _programme(along: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Shift (2) and tilt (2) of the axis that make the shell thinnest."""
    radius = np.maximum(np.hypot(x, y), 1e-9)
    reach = max(float(np.abs(along).max()), 1e-9)
    slope = -np.column_stack([x, y, x * along / reach, y * along / reach]) / radius[:, None]
    order = np.argsort(radius)
    used = np.zeros(len(radius), dtype=np.bool_)
    used[order[:_FIRST]] = used[order[-_FIRST:]] = True
    step = np.zeros(4)
    for _ in range(6):
        ones = np.ones(int(used.sum()))
        # Of step, outer and inner radius: r + slope step <= outer, >= inner.
        above = np.column_stack([slope[used], -ones, 0 * ones])
        below = np.column_stack([-slope[used], 0 * ones, ones])
        solution = linprog(
            [0, 0, 0, 0, 1, -1],
            np.vstack([above, below]),
            np.concatenate([-radius[used], radius[used]]),
            bounds=[(-0.1, 0.1)] * 4 + [(None, None)] * 2,
            method="highs-ds",
        )
        if solution.x is None:
            break
        step = solution.x[:4]
        moved = radius + slope @ step
        outside = (moved > solution.x[4] + 1e-9) | (moved < solution.x[5] - 1e-9)
        if not (outside & ~used).any():
            break
        used |= outside
    return np.concatenate([step[:2], step[2:] / reach])


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
