"""Height map of written ink over x and y; highest ink under a travel move."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels import jit
from kernels.arrays import FloatArray

MAX_CELLS = 4_000_000
"""Of the map; a larger part gets coarser cells."""


class Ground(NamedTuple):
    """Highest ink that a needle would touch with its tip over each cell, mm; -inf over none.

    Attributes
    ----------
    origin : (2,) float64, mm
    cell_mm : float, mm
    top : (nx, ny) float64, mm
    """

    origin: FloatArray
    cell_mm: float
    top: FloatArray


def ground_under(points: FloatArray, shaft_mm: float, thickest_mm: float) -> Ground:
    """A map over (n, 3) points with nothing on it, in cells of a third of the shaft's radius."""
    room = shaft_mm + thickest_mm + shaft_mm
    low, high = points[:, :2].min(axis=0) - room, points[:, :2].max(axis=0) + room
    cell = max(shaft_mm / 3.0, float(np.sqrt((high - low).prod() / MAX_CELLS)))
    shape = np.ceil((high - low) / cell).astype(np.int64) + 1
    return Ground(low, cell, np.full(shape, -np.inf))


@jit
def lay(ground: Ground, points: FloatArray, radius: FloatArray, shaft: float) -> None:
    """Note a filament along (k, 3) points of radii (k,)."""
    for k in range(len(points) - 1):
        a, b = points[k], points[k + 1]
        thick = max(radius[k], radius[k + 1])
        # Cells are told by their middles: half a diagonal more is sure.
        reach = shaft + thick + 0.71 * ground.cell_mm
        low_x, high_x = _cells(min(a[0], b[0]) - reach, max(a[0], b[0]) + reach, ground, 0)
        low_y, high_y = _cells(min(a[1], b[1]) - reach, max(a[1], b[1]) + reach, ground, 1)
        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        length2 = dx * dx + dy * dy
        for i in range(low_x, high_x):
            x = ground.origin[0] + (i + 0.5) * ground.cell_mm
            for j in range(low_y, high_y):
                y = ground.origin[1] + (j + 0.5) * ground.cell_mm
                t = ((x - a[0]) * dx + (y - a[1]) * dy) / length2 if length2 > 0.0 else 0.0
                t = min(max(t, 0.0), 1.0)
                ox, oy = a[0] + t * dx - x, a[1] + t * dy - y
                if ox * ox + oy * oy < reach * reach:
                    # Within reach it may be higher than here, but not than its upper end.
                    slope = abs(dz) / np.sqrt(length2) if length2 > 0.0 else np.inf
                    high = min(max(a[2], b[2]), a[2] + t * dz + slope * reach)
                    ground.top[i, j] = max(ground.top[i, j], high + thick)


@jit
def highest_along(ground: Ground, start: FloatArray, end: FloatArray) -> float:
    """Highest ink under a straight way in the plan, mm; -inf over none."""
    way = np.hypot(end[0] - start[0], end[1] - start[1])
    count = int(np.ceil(2.0 * way / ground.cell_mm)) + 1
    top = -np.inf
    for k in range(count + 1):
        t = k / count
        x = start[0] + t * (end[0] - start[0])
        y = start[1] + t * (end[1] - start[1])
        low_x, high_x = _cells(x - ground.cell_mm / 2.0, x + ground.cell_mm / 2.0, ground, 0)
        low_y, high_y = _cells(y - ground.cell_mm / 2.0, y + ground.cell_mm / 2.0, ground, 1)
        for i in range(low_x, high_x):
            for j in range(low_y, high_y):
                top = max(top, ground.top[i, j])
    return float(top)


@jit
def _cells(low: float, high: float, ground: Ground, axis: int) -> tuple[int, int]:
    """First cell and one past the last that a stretch of an axis meets."""
    count = ground.top.shape[axis]
    first = int(np.floor((low - ground.origin[axis]) / ground.cell_mm))
    last = int(np.floor((high - ground.origin[axis]) / ground.cell_mm)) + 1
    return min(max(first, 0), count), min(max(last, 0), count)
