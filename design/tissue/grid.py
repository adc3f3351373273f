"""Signed distance grid of a tissue: distance at points, test if vessel capsules lie inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.tissue.arrays import BRICK, GridArrays
from design.tissue.depth import depth_along
from kernels import pjit, scalar_jit
from kernels.arrays import FloatArray


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
