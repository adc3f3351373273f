"""Compute exactly the least depth of a segment below a tissue's surface.

Samples of the grid are exact distances, and a distance changes by no more than the way gone: a
sample of depth d at distance a from a point proves a depth of d - a there. Where such bounds
don't settle it, the segment is measured from the surface's triangles. Reads between samples are
no proof: the surface may fold back within a cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry.bvh import DEPTH
from design.geometry.surface_distances import segment_distance
from design.tissue.arrays import BAND_CELLS, BRICK, GridArrays
from design.tissue.columns import crossing, crossing_place
from kernels import jit, scalar_jit

SLACK_CELLS = 1e-4
"""Taken off each bound, in fine cells: a sample's sign is that of a place beside it (see
`cross_columns`), and samples are rounded to float32."""

PIECE_CELLS = 1.5
"""Longest piece measured from the triangles at once, in fine cells: the boxes of longer ones meet
too many."""


@scalar_jit
def depth_bounds(grid: GridArrays, x: float, y: float, z: float) -> tuple[float, float]:
    """Proven bounds of the depth below the surface at a point, mm; negative outside."""
    h = grid.spacing
    u, v, w = (x - grid.origin[0]) / h, (y - grid.origin[1]) / h, (z - grid.origin[2]) / h
    na, nb, nc = grid.brick.shape
    if not (0.0 <= u < BRICK * na and 0.0 <= v < BRICK * nb and 0.0 <= w < BRICK * nc):
        # The grid reaches a quarter of a brick beyond the tissue.
        return -np.inf, -h
    a, b, c = int(u) // BRICK, int(v) // BRICK, int(w) // BRICK
    u -= BRICK * a
    v -= BRICK * b
    w -= BRICK * c
    brick = grid.brick[a, b, c]
    if brick < 0:
        i, j, k = int(u > 0.5 * BRICK), int(v > 0.5 * BRICK), int(w > 0.5 * BRICK)
        depth = -grid.coarse[a + i, b + j, c + k]
        if depth <= 0.0:
            # Outside, or inside with a lowered sample.
            return -np.inf, np.inf
        away = np.sqrt((u - BRICK * i) ** 2 + (v - BRICK * j) ** 2 + (w - BRICK * k) ** 2)
        return max(depth - away * h, BAND_CELLS * h) - SLACK_CELLS * h, np.inf
    i, j, k = int(u), int(v), int(w)
    u -= i
    v -= j
    w -= k
    cell = grid.samples[brick]
    lower, upper = -np.inf, np.inf
    for p in range(2):
        from_x = (u - p) * (u - p)
        for q in range(2):
            from_xy = from_x + (v - q) * (v - q)
            low = h * np.sqrt(from_xy + w * w)
            high = h * np.sqrt(from_xy + (1.0 - w) * (1.0 - w))
            one, two = -cell[i + p, j + q, k], -cell[i + p, j + q, k + 1]
            lower = max(lower, max(one - low, two - high))
            upper = min(upper, min(one + low, two + high))
    return lower - SLACK_CELLS * h, upper + SLACK_CELLS * h


@jit
def winding_number(surface: Any, x: float, y: float, z: float) -> int:
    """How often the surface winds around a point: crossings beyond it along x."""
    total = 0
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        low, high = surface.low[node], surface.high[node]
        if x > high[0] or y < low[1] or y > high[1] or z < low[2] or z > high[2]:
            continue
        if surface.right[node] >= 0:
            stack[top] = surface.right[node]
            stack[top + 1] = node + 1
            top += 2
            continue
        for n in range(surface.first[node], surface.first[node] + surface.size[node]):
            corners = surface.triangles[n].reshape(3, 3)
            sign = crossing(corners, y, z)
            if sign != 0 and crossing_place(corners, y, z) > x:
                total -= sign
    return total


@jit
def enclosed(surface: Any, points: Any) -> Any:
    """Whether the surface winds around each of ``points`` (n, 3), (n,) bool."""
    inside = np.empty(len(points), np.bool_)
    for n in range(len(points)):
        inside[n] = winding_number(surface, points[n, 0], points[n, 1], points[n, 2]) > 0
    return inside


@scalar_jit
def least_depth_along(
    grid: GridArrays,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    most: float,
    enough: float,
) -> float:
    """Least depth below the surface along segment ab, mm, where it is below ``most``.

    Parameters
    ----------
    most : float, mm
        Returned when the whole segment is at least that deep.
    enough : float, mm
        The search ends at a depth below it, which is then returned.

    Returns
    -------
    float
        Some negative depth where the segment passes the surface or is outside.
    """
    h = grid.spacing
    dx, dy, dz = bx - ax, by - ay, bz - az
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / length if length > 0.0 else 0.0
    least = most
    inside = False
    at = 0.0
    size = length
    while True:
        size = min(size, length - at)
        half = 0.5 * size
        t = (at + half) * scale
        lower, upper = depth_bounds(grid, ax + t * dx, ay + t * dy, az + t * dz)
        if upper < enough:
            return upper
        if lower > 0.0:
            inside = True
        if lower - half < least:
            if size > PIECE_CELLS * h:
                size = half
                continue
            s, e = at * scale, (at + size) * scale
            away = segment_distance(
                grid,
                ax + s * dx,
                ay + s * dy,
                az + s * dz,
                ax + e * dx,
                ay + e * dy,
                az + e * dz,
                least,
            )
            if away <= 0.0:
                return -SLACK_CELLS * h
            least = min(least, away)
            if least < enough:
                return least
        at += size
        size *= 2.0
        if at >= length:
            break
    # What doesn't pass the surface is inside as a whole or not at all.
    if not inside and winding_number(grid, bx, by, bz) <= 0:
        return -least
    return least


@scalar_jit
def depth_along(
    grid: GridArrays,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    need: float,
) -> float:
    """Depth of segment ab, to be compared with ``need``: at least that where it's so deep."""
    return least_depth_along(grid, ax, ay, az, bx, by, bz, need, need)
