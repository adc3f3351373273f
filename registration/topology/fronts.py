"""Fronts that grow through the designed gel from every lumen and from the outside, and meet.

Dijkstra's algorithm (1959, 10.1007/BF01386390) over the 26 neighbours of each voxel, from all
walls at once: each voxel is reached from the wall that is nearest by cost. Two fronts that meet
close a way between two walls, and the cheapest such ways are the candidates.
"""

from __future__ import annotations

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
    # Neighbours are asked for cost and mean together: side by side they are fetched once.
    known = np.empty((label.size, 2), dtype=np.float32)
    known[:, 0], known[:, 1] = np.inf, mean.ravel()
    parent = np.full(label.size, -1, dtype=np.int64)
    to_reach = label.ravel() == UNREACHED
    # Length of a step by how many axes it goes along, and which step led to each voxel.
    ways, slant = step * np.sqrt(np.arange(4.0)), np.zeros(label.size, dtype=np.uint8)
    waiting, count = np.empty(1024, dtype=np.uint64), 0
    bits = np.empty(1, dtype=np.float32)
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if label[z, y, x] >= -1 and _beside(label, z, y, x):
                    flat = (z * ny + y) * nx + x
                    known[flat, 0] = 0.0
                    waiting, count = _pushed(waiting, count, np.float32(0.0), flat, bits)
    order, reached = np.empty(label.size, dtype=np.int64), 0
    while count > 0:
        flat, count = _popped(waiting, count)
        first = parent[flat] < 0
        if not first and not to_reach[flat]:
            continue
        to_reach[flat] = False
        if not first:
            order[reached] = flat
            reached += 1
        z, rest = flat // (ny * nx), flat % (ny * nx)
        y, x = rest // nx, rest % nx
        here, own = known[flat, 0], known[flat, 1]
        for k in range(max(z - 1, 0), min(z + 2, nz)):
            for j in range(max(y - 1, 0), min(y + 2, ny)):
                row, aside = (k * ny + j) * nx, int(k != z) + int(j != y)
                for i in range(max(x - 1, 0), min(x + 2, nx)):
                    other = row + i
                    if not to_reach[other]:
                        continue
                    both = known[other, 1] if first else 0.5 * (own + known[other, 1])
                    along = aside + int(i != x)
                    there = np.float32(here + ways[along] * price(both))
                    if there < known[other, 0] and there < most:
                        known[other, 0], parent[other], slant[other] = there, flat, along
                        waiting, count = _pushed(waiting, count, there, other, bits)
    return _told_along(label, mean, ways, slant, known[:, 0], parent, order[:reached])


@jit
def _told_along(
    label: IntVolume,
    mean: FloatVolume,
    ways: NDArray[np.float64],
    slant: NDArray[np.uint8],
    cost: NDArray[np.float32],
    parent: IntArray,
    order: IntArray,
) -> tuple[FloatVolume, FloatVolume, FloatVolume, FloatVolume, IntArray]:
    """Fill in labels, and return what `grow` does, along the ways to voxels in their order."""
    length = np.zeros(label.size, dtype=np.float32)
    gel = np.zeros(label.size, dtype=np.float32)
    worst = np.zeros(label.size, dtype=np.float32)
    whose, values = label.ravel(), mean.ravel()
    for place in range(len(order)):
        flat = order[place]
        before = parent[flat]
        way = ways[slant[flat]]
        both = 0.5 * (values[before] + values[flat]) if parent[before] >= 0 else values[flat]
        whose[flat] = whose[before]
        length[flat] = length[before] + way
        gel[flat] = gel[before] + way * both
        worst[flat] = max(worst[before], values[flat])
    shape = label.shape
    return (
        cost.copy().reshape(shape), length.reshape(shape), gel.reshape(shape),
        worst.reshape(shape), parent,
    )  # fmt: skip


@jit
def _pushed(
    waiting: NDArray[np.uint64], count: int, cost: np.float32, flat: int, bits: NDArray[np.float32]
) -> tuple[NDArray[np.uint64], int]:
    """Put a voxel into a heap of four children a node; return the heap and how many it holds.

    An entry is the bits of the cost, which order as costs from 0 do, over the voxel's number: the
    cheapest first, and of equal ones that with the lowest number. `bits`: room for one cost.
    """
    if count == len(waiting):
        more = np.empty(2 * count, dtype=np.uint64)
        more[:count] = waiting
        waiting = more
    bits[0] = cost
    entry = (np.uint64(bits.view(np.uint32)[0]) << np.uint64(32)) | np.uint64(flat)
    place = count
    while place > 0:
        above = (place - 1) >> 2
        if waiting[above] <= entry:
            break
        waiting[place] = waiting[above]
        place = above
    waiting[place] = entry
    return waiting, count + 1


@jit
def _popped(waiting: NDArray[np.uint64], count: int) -> tuple[np.int64, int]:
    """Take the cheapest voxel out; return it and how many are left."""
    first, last = waiting[0], waiting[count - 1]
    count -= 1
    place = 0
    while 4 * place + 1 < count:
        least = 4 * place + 1
        for child in range(least + 1, min(least + 4, count)):
            if waiting[child] < waiting[least]:
                least = child
        if waiting[least] >= last:
            break
        waiting[place] = waiting[least]
        place = least
    waiting[place] = last
    return np.int64(first & np.uint64(0xFFFFFFFF)), count


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
