"""Build the signed distance grid of a closed mesh."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry import (
    TriangleTree,
    build_triangle_tree,
    gather_within,
    nearest_distance,
    point_triangle_squared,
)
from design.tissue.arrays import BAND_CELLS, BRICK, GridArrays
from design.tissue.columns import Columns, cross_columns
from design.tissue.grid import SignedDistanceGrid, mix, read
from kernels import jit, pjit

FloatArray = NDArray[np.float64]

_SIDE = BRICK + 1
_HALF_DIAGONAL = 0.5 * BRICK * sqrt(3.0)
_GROUP_HALF_DIAGONAL = sqrt(3.0)
_CHUNK = 16


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
    samples = _fill_bricks(tree, columns, origin, spacing_mm, places)
    coarse = _lowered(tree, coarse, brick, origin, spacing_mm)
    arrays = GridArrays(origin, float(spacing_mm), coarse, brick, samples, *tree)
    error, deepest = _measure(tree, arrays, places)
    return SignedDistanceGrid(arrays, float(error), float(max(deepest, -coarse.min()))), columns


@jit
def winding(columns: Columns, j: int, k: int, x: float) -> int:
    """Winding number at place ``x`` of line (j, k)."""
    line = j * columns.shape[1] + k
    total = 0
    for i in range(columns.start[line], columns.start[line + 1]):
        if columns.where[i] > x:
            break
        total += columns.turn[i]
    return total


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
    """How far reads in each coarse inner cell exceed the exact depth, at 19 of its points."""
    a, b, c = brick.shape
    over = np.zeros((a, b, c), np.float32)
    for i in prange(a):
        for j in range(b):
            for k in range(c):
                if brick[i, j, k] >= 0 or coarse[i, j, k] > 0.0:
                    continue
                for corner in range(27):
                    u, v, w = corner // 9, (corner // 3) % 3, corner % 3
                    if u != 1 and v != 1 and w != 1:
                        continue
                    x = origin[0] + (i + 0.5 * u) * BRICK * h
                    y = origin[1] + (j + 0.5 * v) * BRICK * h
                    z = origin[2] + (k + 0.5 * w) * BRICK * h
                    depth = -mix(coarse, int(np.int64(i)), j, k, 0.5 * u, 0.5 * v, 0.5 * w)
                    exact = nearest_distance(tree, x, y, z, depth)
                    over[i, j, k] = max(over[i, j, k], depth - exact)
    return over


def _lowered(tree: Any, coarse: Any, brick: Any, origin: FloatArray, h: float) -> Any:
    """Coarse samples with depths lowered so that reads between them aren't too deep.

    Where the distance is convex (around a re-entrant edge) a linear read between coarse
    samples exceeds it; each corner is lowered by the largest excess of the cells it serves.
    """
    over = np.pad(_overshoot(tree, coarse, brick, origin, h), 1)
    most = np.zeros_like(coarse)
    for shift in np.ndindex(2, 2, 2):
        window = tuple(slice(s, s + n) for s, n in zip(shift, coarse.shape, strict=True))
        most = np.maximum(most, over[window])
    return coarse + np.where(coarse < 0, most, 0).astype(np.float32)


@pjit
def _fill_bricks(tree: Any, columns: Any, origin: Any, h: float, places: Any) -> Any:
    samples = np.empty((len(places), _SIDE, _SIDE, _SIDE), np.float32)
    chunks = (len(places) + _CHUNK - 1) // _CHUNK
    for chunk in prange(chunks):
        room = len(tree.triangles)
        found, group = np.empty(room, np.int32), np.empty(room, np.int32)
        near = np.empty(room)
        for n in range(chunk * _CHUNK, min(len(places), (chunk + 1) * _CHUNK)):
            _fill_brick(tree, columns, origin, h, places[n], found, group, near, samples[n])
    return samples


@jit
def _fill_brick(
    tree: Any,
    columns: Any,
    origin: Any,
    h: float,
    place: Any,
    found: Any,
    group: Any,
    near: Any,
    out: Any,
) -> None:
    """Exact signed distances of a brick's samples.

    A sample's nearest triangle is no farther from the brick's centre than the centre's own
    nearest plus a diagonal; the same holds for each group of 3 x 3 x 3 samples, so few
    triangles are left to be measured from each sample.
    """
    half = 0.5 * BRICK
    cx = origin[0] + (place[0] * BRICK + half) * h
    cy = origin[1] + (place[1] * BRICK + half) * h
    cz = origin[2] + (place[2] * BRICK + half) * h
    central = nearest_distance(tree, cx, cy, cz, np.inf)
    size = gather_within(tree, cx, cy, cz, (central + 2.0 * _HALF_DIAGONAL * h) * 1.0001, found)
    for gi in range(0, _SIDE, 3):
        for gj in range(0, _SIDE, 3):
            for gk in range(0, _SIDE, 3):
                mx = cx + (gi + 1 - half) * h
                my = cy + (gj + 1 - half) * h
                mz = cz + (gk + 1 - half) * h
                few = _near_group(tree, mx, my, mz, h, found, size, group, near)
                for i in range(gi, gi + 3):
                    x = cx + (i - half) * h
                    for j in range(gj, gj + 3):
                        y = cy + (j - half) * h
                        for k in range(gk, gk + 3):
                            away = _nearest_of(tree, x, y, cz + (k - half) * h, h, group, near, few)
                            inside = winding(columns, place[1] * BRICK + j, place[2] * BRICK + k, x)
                            out[i, j, k] = -away if inside > 0 else away


@jit
def _near_group(
    tree: Any, x: float, y: float, z: float, h: float, found: Any, size: int, group: Any, near: Any
) -> int:
    """Triangles that can be nearest to a sample of the group around a point, nearest first.

    Distances from the point go to ``near``, triangles to ``group``; returns how many.
    """
    least = np.inf
    slack = 2.0 * _GROUP_HALF_DIAGONAL * h * 1.0001
    few = 0
    for n in range(size):
        t = found[n]
        dx, dy, dz = tree.centre[t, 0] - x, tree.centre[t, 1] - y, tree.centre[t, 2] - z
        # No corner is farther from the centre than its reach.
        bound = least + slack + tree.reach[t]
        if dx * dx + dy * dy + dz * dz > bound * bound:
            continue
        away = sqrt(point_triangle_squared(x, y, z, tree.triangles[t]))
        if away > least + slack:
            continue
        least = min(least, away)
        at = few
        while at > 0 and near[at - 1] > away:
            near[at] = near[at - 1]
            group[at] = group[at - 1]
            at -= 1
        near[at] = away
        group[at] = t
        few += 1
    while near[few - 1] > least + slack:
        few -= 1
    return few


@jit
def _nearest_of(
    tree: Any, x: float, y: float, z: float, h: float, group: Any, near: Any, few: int
) -> float:
    """Distance of a sample from the nearest triangle of its group."""
    best = np.inf
    for n in range(few):
        least = near[n] - _GROUP_HALF_DIAGONAL * h
        if least > 0.0 and least * least > best:
            break
        best = min(best, point_triangle_squared(x, y, z, tree.triangles[group[n]]))
    return sqrt(best)


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
