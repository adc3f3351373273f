"""Signed distance grid of a tissue: distance at points, test if vessel capsules lie inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.bvh import DEPTH
from design.geometry.surface_distances import segment_distance
from design.tissue.grid_lines import crossing, crossing_place
from kernels import jit, pjit, scalar_jit
from kernels.arrays import FloatArray

BRICK = 8
"""Fine cells along a brick's edge; a coarse cell is as large as a brick."""
BAND_CELLS = 2.0
"""Fine cells beyond the surface that bricks cover at least."""


class GridArrays(NamedTuple):
    """Samples of the signed distance, and the surface itself.

    Attributes
    ----------
    origin : (3,) float64, mm
        Sample (0, 0, 0).
    spacing : float, mm
        Of the fine samples.
    coarse : (a + 1, b + 1, c + 1) float32, mm
        Signed distance at the corners of the coarse cells.
    brick : (a, b, c) int32
        Which brick refines a coarse cell, -1 for none.
    samples : (n, 9, 9, 9) float32, mm
        Signed distance in each brick, its far faces included, so that a read stays in it.
    triangles ... size
        The exact surface, measured where the samples don't decide: a `TriangleTree`, field
        by field, since numba's parallel loops take no tuple within a tuple. Kernels that take
        a tree take these arrays as well.
    """

    origin: NDArray[np.float64]
    spacing: float
    coarse: NDArray[np.float32]
    brick: NDArray[np.int32]
    samples: NDArray[np.float32]
    triangles: NDArray[np.float64]
    face: NDArray[np.int32]
    centre: NDArray[np.float64]
    reach: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    right: NDArray[np.int32]
    first: NDArray[np.int32]
    size: NDArray[np.int32]


@scalar_jit
def read(grid: GridArrays, x: float, y: float, z: float) -> float:
    """Signed distance at a point by trilinear interpolation, mm; negative inside.

    Beyond the grid, the distance from the grid is added to the value at its edge.
    """
    h = grid.spacing
    u, v, w = (x - grid.origin[0]) / h, (y - grid.origin[1]) / h, (z - grid.origin[2]) / h
    na, nb, nc = grid.brick.shape
    # A hair below the far edge keeps the last cell's index in range.
    uc = min(max(u, 0.0), BRICK * na - 1e-9)
    vc = min(max(v, 0.0), BRICK * nb - 1e-9)
    wc = min(max(w, 0.0), BRICK * nc - 1e-9)
    beyond = 0.0
    if uc != u or vc != v or wc != w:
        beyond = h * np.sqrt((u - uc) ** 2 + (v - vc) ** 2 + (w - wc) ** 2)
    a, b, c = int(uc) // BRICK, int(vc) // BRICK, int(wc) // BRICK
    uc -= BRICK * a
    vc -= BRICK * b
    wc -= BRICK * c
    brick = grid.brick[a, b, c]
    if brick >= 0:
        i, j, k = int(uc), int(vc), int(wc)
        return beyond + mix(grid.samples[brick], i, j, k, uc - i, vc - j, wc - k)
    return beyond + mix(grid.coarse, a, b, c, uc / BRICK, vc / BRICK, wc / BRICK)


@scalar_jit
def mix(values: Any, i: int, j: int, k: int, u: float, v: float, w: float) -> float:
    """Trilinear mix of the eight samples around a cell's inner coordinates (0 to 1)."""
    c00 = values[i, j, k] * (1.0 - w) + values[i, j, k + 1] * w
    c01 = values[i, j + 1, k] * (1.0 - w) + values[i, j + 1, k + 1] * w
    c10 = values[i + 1, j, k] * (1.0 - w) + values[i + 1, j, k + 1] * w
    c11 = values[i + 1, j + 1, k] * (1.0 - w) + values[i + 1, j + 1, k + 1] * w
    return (c00 * (1.0 - v) + c01 * v) * (1.0 - u) + (c10 * (1.0 - v) + c11 * v) * u


@pjit
def _read_all(grid: GridArrays, points: Any) -> Any:
    value = np.empty(len(points))
    for i in prange(len(points)):
        value[i] = read(grid, points[i, 0], points[i, 1], points[i, 2])
    return value


@pjit
def _depth_all(grid: GridArrays, start: Any, end: Any, need: Any) -> Any:
    value = np.empty(len(start))
    for i in prange(len(start)):
        a, b = start[i], end[i]
        value[i] = depth_along(grid, a[0], a[1], a[2], b[0], b[1], b[2], need[i])
    return value


@dataclass(frozen=True)
class SignedDistanceGrid:
    """Signed distance from a tissue's surface: fine bricks near it, coarse cells elsewhere.

    Attributes
    ----------
    arrays : GridArrays
        Samples; see there.
    error_mm : float
        Largest depth by which a read near the surface, at points tried while building,
        exceeded the exact depth: a measure of the reads, not a bound. Depths along segments
        don't rest on reads.
    deepest_mm : float
        Largest sampled depth below the surface.
    """

    arrays: GridArrays
    error_mm: float
    deepest_mm: float

    @property
    def spacing_mm(self) -> float:
        """Distance between fine samples, mm."""
        return float(self.arrays.spacing)

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,) at ``points`` (n, 3), mm; negative inside."""
        values: FloatArray = _read_all(self.arrays, np.ascontiguousarray(points, dtype=np.float64))
        return values

    def capsule_inside(
        self, start: FloatArray, end: FloatArray, radius: FloatArray, clearance_mm: float = 0.0
    ) -> NDArray[np.bool_]:
        """Whether capsules (axis ``start``-``end`` (n, 3), ``radius`` (n,), mm) are in the tissue.

        ``clearance_mm`` is added to the radius. Exact, whatever the spacing.
        """
        need = np.asarray(radius, dtype=np.float64) + clearance_mm
        a = np.ascontiguousarray(start, dtype=np.float64)
        b = np.ascontiguousarray(end, dtype=np.float64)
        depth: FloatArray = _depth_all(self.arrays, a, b, need)
        return depth >= need


# Samples of the grid are exact distances, and a distance changes by no more than the way gone: a
# sample of depth d at distance a from a point proves a depth of d - a there. Where such bounds
# don't settle it, the segment is measured from the surface's triangles. Reads between samples are
# no proof: the surface may fold back within a cell.
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
