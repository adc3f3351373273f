"""Find the radius of the largest disc inside a layer's contours at each contour point.

The disc of radius r that touches the contour at p, its centre p + r n on the inward normal n,
touches a point q of another edge when |q - p|² = 2 r n·(q - p); r is least over all q (the
shrinking ball of Ma et al. 2012, doi 10.1007/s00371-012-0689-8, on edges instead of points).
Only edges that face p count, so that a corner isn't held to be a narrow place.
"""

from __future__ import annotations

import math

import numpy as np

from design.toolpath.fresh.cells import Cells, put_in_cells
from design.toolpath.fresh.contours import Samples
from kernels import jit
from kernels.arrays import FloatArray, IntArray

#: Two edges face each other when the product of their normals is below this.
FACING = -0.2


@jit
def _ball(ux: float, uy: float, vx: float, vy: float, nx: float, ny: float) -> float:
    """Radius of the disc from the origin along n that touches the edge u to u + v."""
    a, b, c = vx * vx + vy * vy, ux * vx + uy * vy, ux * ux + uy * uy
    d, e = nx * ux + ny * uy, nx * vx + ny * vy
    least = math.inf
    if d > 1e-9:
        least = c / (2 * d)
    if d + e > 1e-9:
        least = min(least, (a + 2 * b + c) / (2 * (d + e)))
    # Between the ends where the derivative vanishes: a e s² + 2 a d s = e c - 2 b d.
    places = (math.nan, math.nan)
    if abs(e) > 1e-12 * a:
        root = (a * d) ** 2 - a * e * (2 * b * d - e * c)
        if root >= 0:
            root = math.sqrt(root)
            places = ((-a * d + root) / (a * e), (-a * d - root) / (a * e))
    elif d > 1e-9:
        places = (-b / a, math.nan)
    for s in places:
        if 0 < s < 1 and d + e * s > 1e-9:
            least = min(least, (a * s * s + 2 * b * s + c) / (2 * (d + e * s)))
    return least


@jit
def _room(
    points: FloatArray, normal: FloatArray, cells: Cells, most: float
) -> tuple[FloatArray, IntArray]:
    low, side, start, end = cells.low, cells.side, cells.start, cells.end
    radius = np.full(len(points), most)
    other = np.full(len(points), -1, np.int64)
    for k in range(len(points)):
        px, py = points[k, 0], points[k, 1]
        nx, ny = normal[k, 0], normal[k, 1]
        # The disc of the largest radius lies in this box.
        x0 = max(int((px + most * nx - most - low[0]) / side), 0)
        x1 = min(int((px + most * nx + most - low[0]) / side), cells.columns - 1)
        y0 = max(int((py + most * ny - most - low[1]) / side), 0)
        y1 = min(int((py + most * ny + most - low[1]) / side), cells.rows - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                cell = y * cells.columns + x
                for place in range(cells.offset[cell], cells.offset[cell + 1]):
                    j = cells.edge[place]
                    vx, vy = end[j, 0] - start[j, 0], end[j, 1] - start[j, 1]
                    length = math.sqrt(vx * vx + vy * vy)
                    if length < 1e-12 or (-vy * nx + vx * ny) > FACING * length:
                        continue
                    ball = _ball(start[j, 0] - px, start[j, 1] - py, vx, vy, nx, ny)
                    if ball < radius[k]:
                        radius[k] = ball
                        other[k] = j
    return radius, other


def measure_room(samples: Samples, most_mm: float) -> tuple[FloatArray, IntArray]:
    """Radius of the largest disc at each sample, and the edge that it touches on the other side.

    Parameters
    ----------
    samples : Samples
        Sampled more densely than ``most_mm``.
    most_mm : float, mm
        Larger discs aren't looked for.

    Returns
    -------
    radius : (n,) float64, mm
        At most ``most_mm``.
    other : (n,) int64
        Edge, by the sample it begins at; -1 where the disc is of the largest radius.
    """
    if len(samples.normal) == 0:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    cells = put_in_cells(samples.contours, 2 * most_mm)
    return _room(samples.contours.points, samples.normal, cells, most_mm)
