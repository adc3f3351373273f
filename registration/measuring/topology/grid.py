"""Sample design and scan on one voxel grid in the part's frame: designed lumen, scanned void."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.segmentation import GelField

MOST_VOXELS = 12_000_000
"""Above this the grid is laid coarser, which `LumenGrid.step_mm` tells."""


@dataclass(frozen=True)
class LumenGrid:
    """Design and scan on one grid, part frame.

    Attributes
    ----------
    origin_mm : (3,) float64, mm
        Place of voxel (0, 0, 0), as x, y, z.
    step_mm : float, mm
        Edge of the voxels.
    wall_mm : (nz, ny, nx) float32, mm
        Distance to the designed lumens' wall, negative inside; held at `reach_mm` beyond it.
        Of round, tapered vessels about the network's axes: near an axis' end a half ball.
    owner : (nz, ny, nx) int32
        Vessel whose wall that is; -1 beyond the reach.
    reach_mm : float, mm
        How far `wall_mm` goes.
    free : (nz, ny, nx) bool
        Below the gel's level in the scan.
    known : (nz, ny, nx) bool
        In the field of view.
    """

    origin_mm: FloatArray
    step_mm: float
    wall_mm: NDArray[np.float32]
    owner: NDArray[np.int32]
    reach_mm: float
    free: NDArray[np.bool_]
    known: NDArray[np.bool_]

    def places(self, index: NDArray[np.int64]) -> FloatArray:
        """Places (n, 3), mm, of voxels (n, 3) given as z, y, x."""
        return np.asarray(self.origin_mm + self.step_mm * index[:, ::-1])


def lay_grid(
    network: VesselNetwork,
    field: GelField,
    fit: Fit,
    bounds: FloatArray,
    step_mm: float,
    reach_mm: float,
) -> LumenGrid:
    """Lay a grid over a box and look design and scan up on it.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    field : GelField
        The scan's gel.
    fit : Fit
        Scan to part.
    bounds : (2, 3) mm
        Of the grid.
    step_mm : float, mm
        Wanted edge of a voxel.
    reach_mm : float, mm
        How far around the lumens.
    """
    low, high = bounds
    step = max(step_mm, float((np.prod(high - low) / MOST_VOXELS) ** (1 / 3)))
    nx, ny, nz = np.maximum(np.floor((high - low) / step).astype(int), 1).tolist()
    origin = (low + high) / 2 - step * (np.array([nx, ny, nz]) - 1) / 2
    wall, owner = _walls(network, origin, step, (nz, ny, nx), reach_mm)
    free, known = _scanned(field, fit, origin, step, (nz, ny, nx))
    return LumenGrid(origin, step, wall, owner, reach_mm, free, known)


def scanned_with(grid: LumenGrid, field: GelField, fit: Fit) -> LumenGrid:
    """The same grid with the scan looked up by another fit."""
    shape = (grid.free.shape[0], grid.free.shape[1], grid.free.shape[2])
    free, known = _scanned(field, fit, grid.origin_mm, grid.step_mm, shape)
    return replace(grid, free=free, known=known)


def _walls(
    network: VesselNetwork,
    origin: FloatArray,
    step: float,
    shape: tuple[int, int, int],
    reach: float,
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Distance to the nearest vessel's wall and whose it is, piece by piece in its own box."""
    wall = np.full(shape, reach, np.float32)
    owner = np.full(shape, -1, np.int32)
    size = np.array(shape[::-1])
    for start, end, r0, r1, vessel in zip(*network.pieces(), strict=True):
        around = max(r0, r1) + reach
        first = np.ceil((np.minimum(start, end) - around - origin) / step).astype(int)
        last = np.floor((np.maximum(start, end) + around - origin) / step).astype(int) + 1
        first, last = np.clip(first, 0, size), np.clip(last, 0, size)
        if (last <= first).any():
            continue
        x, y, z = (origin[k] + step * np.arange(first[k], last[k]) - start[k] for k in range(3))
        way = end - start
        along = (z * way[2])[:, None, None] + (y * way[1])[:, None] + x * way[0]
        along = np.clip(along / (way @ way), 0.0, 1.0)
        away = (x - along * way[0]) ** 2
        away += (y[:, None] - along * way[1]) ** 2
        away += (z[:, None, None] - along * way[2]) ** 2
        distance = (np.sqrt(away) - (r0 + along * (r1 - r0))).astype(np.float32)
        box = tuple(slice(first[k], last[k]) for k in (2, 1, 0))
        nearer = distance < wall[box]
        wall[box] = np.where(nearer, distance, wall[box])
        owner[box] = np.where(nearer, np.int32(vessel), owner[box])
    return wall, owner


def _scanned(
    field: GelField, fit: Fit, origin: FloatArray, step: float, shape: tuple[int, int, int]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Free of gel, and in the field of view, at each grid point; slab by slab."""
    free, known = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    inverse = np.linalg.inv(fit.matrix)
    # The map is affine: along a row of the grid its places are evenly spaced.
    start = inverse[:3, :3] @ origin + inverse[:3, 3]
    ways = step * inverse[:3, :3].T
    x, y = np.arange(shape[2])[:, None] * ways[0], np.arange(shape[1])[:, None] * ways[1]
    flat = y[:, None] + x
    for k in range(shape[0]):
        value = field.above_level(flat + (start + k * ways[2]))
        known[k] = np.isfinite(value)
        free[k] = value < 0
    return free, known
