"""Grow fronts through the designed gel from all lumens and the outside, to find leak paths.

Dijkstra's algorithm (1959, 10.1007/BF01386390) over the 26 neighbours of each voxel, from all
walls at once: each voxel is reached from the wall that is nearest by cost. Two fronts that meet
close a way between two walls, and the cheapest such ways are the candidates.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import IntArray

FloatVolume = NDArray[np.float32]
IntVolume = NDArray[np.int32]
T = TypeVar("T", bound=np.generic)

BARRIER = -3
"""Label of what no front enters."""
UNREACHED = -2
"""Label of gel that no front has reached."""
_CLOSED = np.float32(-1.0)
"""Cost of what no front goes to: none is less."""
_NONE = np.uint8(255)
"""Step that led to where a front begins, or none came."""


@jit
def _begins(label: IntVolume, mean: FloatVolume, known: FloatVolume) -> tuple[IntArray, int]:
    """Fill ``known`` of `grow` for its begin; its index of each voxel of a wall, and how many."""
    nz, ny, nx = label.shape
    voxels, count = np.empty(1024, dtype=np.int64), 0
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                here = ((z + 1) * (ny + 2) + y + 1) * (nx + 2) + x + 1
                known[here, 1] = mean[z, y, x]
                if label[z, y, x] == UNREACHED:
                    known[here, 0] = np.inf
                elif label[z, y, x] >= -1 and _beside(label, z, y, x):
                    known[here, 0] = 0.0
                    if count == len(voxels):
                        voxels = _longer(voxels)
                    voxels[count], count = here, count + 1
    return voxels, count


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
    A step costs its length times `path_cost` of both ends' mean. Voxels wait in buckets by cost
    (Dial 1969, 10.1145/363269.363610), each narrower than the cheapest step, so that their order
    within one doesn't matter. Kept in one kernel for speed.
    """
    # A closed voxel all round saves the looks for the edges.
    nz, ny, nx = label.shape
    along_y, along_z = nx + 2, (ny + 2) * (nx + 2)
    size = (nz + 2) * along_z
    # Neighbours are asked for cost and mean together: side by side they are fetched once.
    known = np.full((size, 2), _CLOSED, dtype=np.float32)
    apart, ways = _neighbours(along_y, along_z, step)
    came = np.full(size, _NONE, dtype=np.uint8)  # which step led to each voxel
    # No step costs less than a bucket is wide: what lies in one is settled when its turn comes.
    width = 0.99 * step * path_cost(0.0)
    top = np.full(int(most / width) + 2, -1, dtype=np.int64)
    voxel, count = _begins(label, mean, known)
    below, offer = np.arange(-1, len(voxel) - 1), np.zeros(len(voxel), dtype=np.float32)
    top[0] = count - 1
    order, reached = np.empty(label.size, dtype=np.int64), 0
    for bucket in range(len(top)):
        while top[bucket] >= 0:
            entry = top[bucket]
            here, cost, top[bucket] = voxel[entry], offer[entry], below[entry]
            if cost > known[here, 0]:
                continue  # reached cheaper since
            own, first = known[here, 1], came[here] == _NONE
            if not first:
                order[reached] = here
                reached += 1
            for k in range(26):
                other = here + apart[k]
                if known[other, 0] <= cost:
                    continue
                both = known[other, 1] if first else 0.5 * (own + known[other, 1])
                there = np.float32(cost + ways[k] * path_cost(both))
                if there >= most or there > known[other, 0]:
                    continue
                if there == known[other, 0]:
                    # Of equal ways that over the cheaper voxel, or over that of lower number.
                    rival = other - apart[came[other]]
                    if (known[rival, 0], rival) > (cost, here):
                        came[other] = k
                    continue
                known[other, 0], came[other] = there, k
                if count == len(voxel):
                    voxel, below, offer = _longer(voxel), _longer(below), _longer(offer)
                later = int(there / width)
                voxel[count], offer[count], below[count] = other, there, top[later]
                top[later], count = count, count + 1
    return _told_along(label, mean, (apart, ways), came, known[:, 0], order[:reached])


@jit
def _neighbours(along_y: int, along_z: int, step: float) -> tuple[IntArray, NDArray[np.float64]]:
    """How far off the 26 neighbours' numbers are, and the ways to them, mm."""
    apart, ways, count = np.empty(26, dtype=np.int64), np.empty(26), 0
    for k in range(-1, 2):
        for j in range(-1, 2):
            for i in range(-1, 2):
                if k != 0 or j != 0 or i != 0:
                    apart[count] = k * along_z + j * along_y + i
                    ways[count] = step * np.sqrt(float(abs(k) + abs(j) + abs(i)))
                    count += 1
    return apart, ways


@jit
def _longer(values: NDArray[T]) -> NDArray[T]:
    """The same values with as much room again behind them."""
    more = np.empty(2 * len(values), dtype=values.dtype)
    more[: len(values)] = values
    return more


@jit
def _told_along(
    label: IntVolume,
    mean: FloatVolume,
    steps: tuple[IntArray, NDArray[np.float64]],
    came: NDArray[np.uint8],
    cost: NDArray[np.float32],
    order: IntArray,
) -> tuple[FloatVolume, FloatVolume, FloatVolume, FloatVolume, IntArray]:
    """Fill in labels, and return what `grow` does, along the ways to voxels in their order.

    `came`, `cost` and `order` count the closed voxels round the volume too; `steps`: `_neighbours`.
    """
    apart, ways = steps
    _, ny, nx = label.shape
    length = np.zeros(label.size, dtype=np.float32)
    gel = np.zeros(label.size, dtype=np.float32)
    worst = np.zeros(label.size, dtype=np.float32)
    whose, values = label.ravel(), mean.ravel()
    inner = np.empty(label.size, dtype=np.float32)
    parent = np.full(label.size, -1, dtype=np.int64)
    for flat in range(label.size):
        own = cost[_inside(flat, ny, nx)]
        inner[flat] = np.inf if own == _CLOSED else own
    for there in order:
        taken = came[there]
        flat, before = _outside(there, ny, nx), _outside(there - apart[taken], ny, nx)
        way = ways[taken]
        both = 0.5 * (values[before] + values[flat]) if parent[before] >= 0 else values[flat]
        parent[flat] = before
        whose[flat] = whose[before]
        length[flat] = length[before] + way
        gel[flat] = gel[before] + way * both
        worst[flat] = max(worst[before], values[flat])
    shape = label.shape
    return (
        inner.reshape(shape), length.reshape(shape), gel.reshape(shape), worst.reshape(shape),
        parent,
    )  # fmt: skip


@jit
def _inside(flat: int, ny: int, nx: int) -> int:
    """Number of a voxel with a closed one all round the volume."""
    z, rest = flat // (ny * nx), flat % (ny * nx)
    return ((z + 1) * (ny + 2) + rest // nx + 1) * (nx + 2) + rest % nx + 1


@jit
def _outside(number: int, ny: int, nx: int) -> int:
    """Number of a voxel without the closed ones."""
    z, rest = number // ((ny + 2) * (nx + 2)), number % ((ny + 2) * (nx + 2))
    return ((z - 1) * ny + rest // (nx + 2) - 1) * nx + rest % (nx + 2) - 1


@jit
def path_cost(mean: float) -> float:
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
    pairs = np.empty((label.size, 2), dtype=np.int64)
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
                    pairs[count, 0], pairs[count, 1] = here, other
                    count += 1
    return pairs[:count].copy()
