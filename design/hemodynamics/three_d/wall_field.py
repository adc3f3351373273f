"""Compute signed distances from lumen walls, and project points onto them (compiled)."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from design.hemodynamics.three_d.cells import Cells
from design.solids.smooth.fillet import COLUMNS, rounded_distance, wall_distance
from kernels import jit
from kernels.arrays import BoolArray, FloatArray

MOST = 64
"""Pieces, the nearest, that a fillet is made of: those of a finely drawn curve crowd there."""

SHARPNESS = 8
"""Power by which a junction's fillet loses its say with distance."""

FADE = 3.0
"""A fillet is whole up to 1 - 1/FADE of a junction's reach."""

FLAT = 0.25
"""Square of the least slope that is believed."""

STEPS = 12
SETTLED = 1e-9
PROBE = 1e-4


@jit
def _near(cells: Cells, x: float, y: float, z: float) -> tuple[int, int]:
    """Where the pieces near a place begin and end in the cells' items."""
    i = int(np.floor((x - cells.low[0]) / cells.size))
    j = int(np.floor((y - cells.low[1]) / cells.size))
    k = int(np.floor((z - cells.low[2]) / cells.size))
    if min(i, j, k) < 0 or i >= cells.shape[0] or j >= cells.shape[1] or k >= cells.shape[2]:
        return 0, 0
    cell = (i * cells.shape[1] + j) * cells.shape[2] + k
    return int(cells.first[cell]), int(cells.first[cell + 1])


@jit
def _fillet(joints: FloatArray, x: float, y: float, z: float) -> float:
    """Radius of the rolling ball: the nearest junction's, blended between two.

    It goes to 0 beyond the junctions' seams: a ball can't pass between vessels that run side by
    side without being joined, and would join them.
    """
    total = weight = reached = 0.0
    for m in range(len(joints)):
        dx, dy, dz = x - joints[m, 0], y - joints[m, 1], z - joints[m, 2]
        away = dx * dx + dy * dy + dz * dz
        near = away / joints[m, 3] ** 2 + 1e-12
        reached = max(reached, min(1.0, FADE * (1.0 - sqrt(away) / joints[m, 5])))
        share = near ** (-SHARPNESS / 2)
        total += share * joints[m, 4]
        weight += share
    return reached * total / weight if weight > 0.0 and reached > 0.0 else 0.0


@jit
def _sharp(
    rows: FloatArray,
    cells: Cells,
    at: FloatArray,
    g: FloatArray,
    near: FloatArray,
    apart: FloatArray,
) -> tuple[float, float, int]:
    """Distance from the nearest piece, from the next one, and how many pieces ``near`` holds.

    The nearest one's gradient goes into ``g`` (3,), the rows of the nearest pieces into ``near``
    and their distances into ``apart``.
    """
    least, second, used = inf, inf, 0
    begin, end = _near(cells, at[0], at[1], at[2])
    for n in range(begin, end):
        row = rows[cells.item[n]]
        a, gx, gy, gz = wall_distance(row, at[0], at[1], at[2])
        if a < least:
            least, second = a, least
            g[0], g[1], g[2] = gx, gy, gz
        else:
            second = min(second, a)
        place = used
        if used == len(apart):
            place = int(np.argmax(apart))
            if apart[place] <= a:
                continue
        else:
            used += 1
        near[place], apart[place] = row, a
    return least, second, used


@jit
def _rounded(near: FloatArray, rho: float, at: FloatArray, g: FloatArray) -> float:
    """Distance from the rounded pieces, and its gradient by differences."""
    x, y, z = at[0], at[1], at[2]
    step = PROBE * rho
    g[0] = rounded_distance(near, rho, x + step, y, z) - rounded_distance(near, rho, x - step, y, z)
    g[1] = rounded_distance(near, rho, x, y + step, z) - rounded_distance(near, rho, x, y - step, z)
    g[2] = rounded_distance(near, rho, x, y, z + step) - rounded_distance(near, rho, x, y, z - step)
    g /= 2.0 * step
    return rounded_distance(near, rho, x, y, z)


@jit
def field(
    rows: FloatArray, joints: FloatArray, cells: Cells, at: FloatArray, g: FloatArray
) -> float:
    """Signed distance at a place, mm; its gradient into ``g`` (3,). inf where no piece is near."""
    near, apart = np.empty((MOST, COLUMNS)), np.empty(MOST)
    least, second, used = _sharp(rows, cells, at, g, near, apart)
    if used < 2:
        return least
    rho = _fillet(joints, at[0], at[1], at[2])
    if rho <= 0.0 or second > 2.0 * rho or least >= rho:
        return least
    return _rounded(near[:used], rho, at, g)


@jit
def distances(
    rows: FloatArray, joints: FloatArray, cells: Cells, points: FloatArray, signed: FloatArray
) -> None:
    """`field` at each of ``points`` (n, 3), into ``signed`` (n,)."""
    g = np.empty(3)
    for n in range(len(points)):
        signed[n] = field(rows, joints, cells, points[n], g)


@jit
def radii(rows: FloatArray, cells: Cells, points: FloatArray, sizes: FloatArray) -> None:
    """Radius of the vessel whose wall is nearest, or that holds the place deepest."""
    for n in range(len(points)):
        least, sizes[n] = inf, 0.0
        begin, end = _near(cells, points[n, 0], points[n, 1], points[n, 2])
        for m in range(begin, end):
            row = rows[cells.item[m]]
            a, _, _, _ = wall_distance(row, points[n, 0], points[n, 1], points[n, 2])
            s = 0.0
            for k in range(3):
                s += (points[n, k] - row[k]) * row[3 + k]
            radius = row[7] + row[8] * min(max(s, 0.0), row[6])
            if abs(a) / radius < least:
                least, sizes[n] = abs(a) / radius, radius


@jit
def project(
    rows: FloatArray,
    joints: FloatArray,
    cells: Cells,
    points: FloatArray,
    plane: FloatArray,
    move: BoolArray,
) -> None:
    """Newton's steps along the gradient, within a plane where its normal isn't 0."""
    g = np.empty(3)
    for n in range(len(points)):
        if not move[n]:
            continue
        for _ in range(STEPS):
            value = field(rows, joints, cells, points[n], g)
            if value == inf:
                break
            across = g[0] * plane[n, 0] + g[1] * plane[n, 1] + g[2] * plane[n, 2]
            g -= across * plane[n]
            square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
            if square < 1e-6:
                break
            # Between walls the field is flat, and Newton's step would go far.
            points[n] -= value / max(square, FLAT) * g
            if abs(value) < SETTLED * sqrt(square):
                break
