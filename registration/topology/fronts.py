"""Fronts that grow through the designed gel from every lumen and from the outside, and meet.

Dijkstra's algorithm (1959, 10.1007/BF01386390) over the 26 neighbours of each voxel, from all
walls at once: each voxel is reached from the wall that is nearest by cost. Two fronts that meet
close a way between two walls, and the cheapest such ways are the candidates.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from kernels import jit

FloatVolume = NDArray[np.float32]
IntVolume = NDArray[np.int32]
IntArray = NDArray[np.int64]

BARRIER = -3
"""Label of what no front enters."""
UNREACHED = -2
"""Label of gel that no front has reached."""


@jit
def grow(
    label: IntVolume, mean: FloatVolume, step: float, most: float
) -> tuple[FloatVolume, FloatVolume, FloatVolume, FloatVolume, IntArray]:
    """Grow all fronts; `label` is filled in place.

    Parameters
    ----------
    label : (nz, ny, nx) int32
        `UNREACHED` in gel by design, `BARRIER` where no front goes; else whose wall it is.
    mean : (nz, ny, nx) float32
        Local mean of the evidence for gel, 1 in gel.
    step : float, mm
        Edge of a voxel.
    most : float, mm
        A front ends where it has cost this.

    Returns
    -------
    cost, length, gel, worst : (nz, ny, nx) float32
        From the wall to each voxel: cost; length, mm; integral of the evidence along it, mm; and
        the largest evidence on it.
    parent : (nz * ny * nx,) int64
        Flat index of the voxel before; -1 at walls and where no front came.

    Notes
    -----
    A step costs its length times `price` of both ends' mean. Kept in one kernel for speed.
    """
    nz, ny, nx = label.shape
    cost = np.full(label.shape, np.inf, dtype=np.float32)
    length = np.zeros(label.shape, dtype=np.float32)
    gel = np.zeros(label.shape, dtype=np.float32)
    worst = np.zeros(label.shape, dtype=np.float32)
    parent = np.full(label.size, -1, dtype=np.int64)
    done = np.zeros(label.shape, dtype=np.bool_)
    heap = [(np.float32(0.0), np.int64(0))]
    heap.pop()
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if label[z, y, x] >= -1 and _beside(label, z, y, x):
                    cost[z, y, x] = 0.0
                    heapq.heappush(heap, (np.float32(0.0), np.int64((z * ny + y) * nx + x)))
    while len(heap) > 0:
        here, flat = heapq.heappop(heap)
        z, rest = flat // (ny * nx), flat % (ny * nx)
        y, x = rest // nx, rest % nx
        if done[z, y, x]:
            continue
        done[z, y, x] = True
        for k in range(max(z - 1, 0), min(z + 2, nz)):
            for j in range(max(y - 1, 0), min(y + 2, ny)):
                for i in range(max(x - 1, 0), min(x + 2, nx)):
                    if done[k, j, i] or not (
                        label[k, j, i] == UNREACHED or parent[(k * ny + j) * nx + i] >= 0
                    ):
                        continue
                    way = step * np.sqrt(float((k - z) ** 2 + (j - y) ** 2 + (i - x) ** 2))
                    both = (
                        0.5 * (mean[z, y, x] + mean[k, j, i])
                        if parent[flat] >= 0
                        else mean[k, j, i]
                    )
                    reached = np.float32(here + way * price(both))
                    if reached < cost[k, j, i] and reached < most:
                        cost[k, j, i] = reached
                        label[k, j, i] = label[z, y, x]
                        length[k, j, i] = length[z, y, x] + way
                        gel[k, j, i] = gel[z, y, x] + way * both
                        worst[k, j, i] = max(worst[z, y, x], mean[k, j, i])
                        parent[(k * ny + j) * nx + i] = flat
                        heapq.heappush(heap, (reached, np.int64((k * ny + j) * nx + i)))
    return cost, length, gel, worst, parent


@jit
def price(mean: float) -> float:
    """Cost of a mm where the evidence has this mean: its square, so that ways go round gel."""
    return max(mean, 0.0) ** 2 + 0.03


@jit
def _beside(label: IntVolume, z: int, y: int, x: int) -> bool:
    """Whether a wall's voxel borders on gel."""
    nz, ny, nx = label.shape
    for k in range(max(z - 1, 0), min(z + 2, nz)):
        for j in range(max(y - 1, 0), min(y + 2, ny)):
            for i in range(max(x - 1, 0), min(x + 2, nx)):
                if label[k, j, i] == UNREACHED:
                    return True
    return False


@jit
def meetings(label: IntVolume, cost: FloatVolume, parent: IntArray) -> IntArray:
    """Voxels (n, 2), flat, where two fronts meet: of each, its cheapest neighbour of another."""
    nz, ny, nx = label.shape
    found = np.empty((label.size, 2), dtype=np.int64)
    count = 0
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                here = (z * ny + y) * nx + x
                if parent[here] < 0:
                    continue
                best, other = np.inf, np.int64(-1)
                for k in range(max(z - 1, 0), min(z + 2, nz)):
                    for j in range(max(y - 1, 0), min(y + 2, ny)):
                        for i in range(max(x - 1, 0), min(x + 2, nx)):
                            flat = (k * ny + j) * nx + i
                            if parent[flat] < 0 or label[k, j, i] == label[z, y, x]:
                                continue
                            if cost[k, j, i] < best:
                                best, other = cost[k, j, i], flat
                if other >= 0:
                    found[count, 0], found[count, 1] = here, other
                    count += 1
    return found[:count].copy()
