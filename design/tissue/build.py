"""Build a tissue's signed distance grid from a closed mesh."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from design.geometry import (
    TriangleTree,
    build_triangle_tree,
    nearest_distance,
)
from design.tissue.arrays import BAND_CELLS, BRICK, GridArrays
from design.tissue.bricks import fill_bricks, winding
from design.tissue.columns import Columns, cross_columns
from design.tissue.grid import SignedDistanceGrid, mix, read
from kernels import jit, pjit
from kernels.arrays import FloatArray

_HALF_DIAGONAL = 0.5 * BRICK * sqrt(3.0)


def build_grid(
    vertices: FloatArray, faces: NDArray[np.int32], spacing_mm: float
) -> tuple[SignedDistanceGrid, Columns]:
    """Build the grid with exact samples; the winding number gives the sign.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int32
        Closed, outward-oriented.
    spacing_mm : float
        Between fine samples.

    Returns
    -------
    SignedDistanceGrid, Columns
        The grid, and the surface crossings along x on its lines.

    Raises
    ------
    TissueError
        When the mesh isn't closed and consistently oriented.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = BRICK * spacing_mm
    counts = np.ceil((high - low) / cell + 0.5).astype(np.int64)
    origin = 0.5 * (low + high) - 0.5 * cell * counts
    tree = build_triangle_tree(vertices, faces)
    fine = BRICK * counts + 1
    columns = cross_columns(vertices[faces], 0, origin, spacing_mm, (int(fine[1]), int(fine[2])))
    coarse = _coarse(tree, columns, origin, spacing_mm, counts + 1)
    brick = _choose_bricks(tree, origin, spacing_mm, counts)
    places = np.argwhere(brick >= 0)
    brick[tuple(places.T)] = np.arange(len(places), dtype=np.int32)
    samples = fill_bricks(tree, columns, origin, spacing_mm, places)
    coarse = _lowered(tree, coarse, brick, origin, spacing_mm)
    arrays = GridArrays(origin, float(spacing_mm), coarse, brick, samples, *tree)
    error, deepest = _measure(tree, arrays, places)
    return SignedDistanceGrid(arrays, float(error), float(max(deepest, -coarse.min()))), columns


@pjit
def _coarse(tree: Any, columns: Any, origin: Any, h: float, shape: Any) -> Any:
    a, b, c = shape
    value = np.empty((a, b, c), np.float32)
    for i in prange(a):
        x = origin[0] + i * BRICK * h
        for j in range(b):
            y = origin[1] + j * BRICK * h
            for k in range(c):
                away = nearest_distance(tree, x, y, origin[2] + k * BRICK * h, np.inf)
                inside = winding(columns, j * BRICK, k * BRICK, x) > 0
                value[i, j, k] = -away if inside else away
    return value


@pjit
def _choose_bricks(tree: Any, origin: Any, h: float, counts: Any) -> Any:
    a, b, c = counts
    reach = (_HALF_DIAGONAL + BAND_CELLS) * h
    brick = np.full((a, b, c), -1, np.int32)
    for i in prange(a):
        x = origin[0] + (i + 0.5) * BRICK * h
        for j in range(b):
            y = origin[1] + (j + 0.5) * BRICK * h
            for k in range(c):
                z = origin[2] + (k + 0.5) * BRICK * h
                if nearest_distance(tree, x, y, z, reach) < reach:
                    brick[i, j, k] = 0
    return brick


@pjit
def _overshoot(tree: Any, coarse: Any, brick: Any, origin: Any, h: float) -> Any:
    """How far reads between coarse samples exceed the exact depth, at points half a cell apart.

    Asked at the middles of inner cells, of their faces and edges, (2 a + 1, 2 b + 1, 2 c + 1).
    """
    a, b, c = brick.shape
    over = np.zeros((2 * a + 1, 2 * b + 1, 2 * c + 1), np.float32)
    for p in prange(2 * a + 1):
        i = min(int(np.int64(p)) // 2, a - 1)
        for q in range(2 * b + 1):
            j = min(q // 2, b - 1)
            for r in range(2 * c + 1):
                k = min(r // 2, c - 1)
                if p % 2 + q % 2 + r % 2 == 0 or not _by_inner_cell(coarse, brick, p, q, r):
                    continue
                depth = -mix(coarse, i, j, k, 0.5 * p - i, 0.5 * q - j, 0.5 * r - k)
                x = origin[0] + 0.5 * p * BRICK * h
                y = origin[1] + 0.5 * q * BRICK * h
                z = origin[2] + 0.5 * r * BRICK * h
                over[p, q, r] = max(0.0, depth - nearest_distance(tree, x, y, z, depth))
    return over


@jit
def _by_inner_cell(coarse: Any, brick: Any, p: int, q: int, r: int) -> bool:
    """Whether a point of the half-cell lattice bounds or lies in an inner cell without a brick."""
    a, b, c = brick.shape
    for i in range(max(0, (p - 1) // 2), min(a, p // 2 + 1)):
        for j in range(max(0, (q - 1) // 2), min(b, q // 2 + 1)):
            for k in range(max(0, (r - 1) // 2), min(c, r // 2 + 1)):
                if brick[i, j, k] < 0 and coarse[i, j, k] <= 0.0:
                    return True
    return False


def _lowered(tree: Any, coarse: Any, brick: Any, origin: FloatArray, h: float) -> Any:
    """Coarse samples with depths lowered so that reads between them aren't too deep.

    Where the distance is convex (around a re-entrant edge) a linear read between coarse
    samples exceeds it; each corner is lowered by the largest excess of the cells it serves.
    """
    each = maximum_filter(_overshoot(tree, coarse, brick, origin, h), size=3)[1::2, 1::2, 1::2]
    over = np.pad(np.where((brick < 0) & (coarse[:-1, :-1, :-1] <= 0), each, 0), 1)
    most = np.zeros_like(coarse)
    for shift in np.ndindex(2, 2, 2):
        window = tuple(slice(s, s + n) for s, n in zip(shift, coarse.shape, strict=True))
        most = np.maximum(most, over[window])
    return coarse + np.where(coarse < 0, most, 0).astype(np.float32)


@pjit
def _measure_bricks(tree: Any, grid: Any, places: Any) -> Any:
    error = np.zeros(len(places))
    deepest = np.zeros(len(places))
    h = grid.spacing
    for n in prange(len(places)):
        deepest[n] = -grid.samples[n].min()
        # One cell centre in each octant, in turn another one.
        for octant in range(8):
            i = 4 * (octant & 1) + n % 4
            j = 2 * (octant & 2) + (n // 4) % 4
            k = (octant & 4) + (n // 16) % 4
            x = grid.origin[0] + (places[n, 0] * BRICK + i + 0.5) * h
            y = grid.origin[1] + (places[n, 1] * BRICK + j + 0.5) * h
            z = grid.origin[2] + (places[n, 2] * BRICK + k + 0.5) * h
            depth = -read(grid, x, y, z)
            if depth > 0.0:
                exact = nearest_distance(tree, x, y, z, np.inf)
                error[n] = max(error[n], depth - exact)
    return error, deepest


def _measure(tree: TriangleTree, arrays: GridArrays, places: Any) -> tuple[float, float]:
    """Largest reading above the exact depth at cell centres tried, and the deepest sample."""
    error, deepest = _measure_bricks(tree, arrays, places)
    return float(error.max(initial=0.0)), float(deepest.max(initial=0.0))
