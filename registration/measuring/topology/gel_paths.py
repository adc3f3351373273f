"""Find liquid-filled paths through designed gel by fronts, with their significance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from kernels import jit
from kernels.arrays import BoolArray, Float32Array, FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.topology.grid import LumenGrid
from registration.segmentation.evidence import SIGMA_MM, GelEvidence

# Dijkstra's algorithm (1959, 10.1007/BF01386390) over the 26 neighbours of each voxel, from all
# walls at once: each voxel is reached from the wall that is nearest by cost. Two fronts that meet
# close a way between two walls, and the cheapest such ways are the candidates.
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
def _begins(label: IntVolume, mean: Float32Array, known: Float32Array) -> tuple[IntArray, int]:
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
    label: IntVolume, mean: Float32Array, step: float, most: float
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array, IntArray]:
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
    mean: Float32Array,
    steps: tuple[IntArray, NDArray[np.float64]],
    came: NDArray[np.uint8],
    cost: NDArray[np.float32],
    order: IntArray,
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array, IntArray]:
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
def meetings(label: IntVolume, cost: Float32Array, parent: IntArray) -> IntArray:
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


OUTSIDE = -1
MOST_COST = 0.7
"""Fronts go through so many mm of gel, or through ways of 0.15 mm for three times as many."""
LEADS_THROUGH = 0.9
"""Evidence for gel that no place on a way exceeds; dead ends run into gel."""
SURE = 10.0
"""Significance from which a way counts though it is faint or its width is ill known; ways of sound
gel, textured by 10 %, reach 6."""
CRACK = 0.67
"""A faint way lacks at least this part of the gel that one of `LEAST_MM` lacks, as a crack half as
wide does."""
LEAST_MM = 0.15
"""Diameter of the narrowest way that is looked for; half of what it lacks of gel is the limit."""
APART_MM = 0.5
"""Ways nearer to each other than this are one."""
_BINS = 8
_LEAST = 300
"""Ways of about one length that tell what sound gel is like."""


@dataclass(frozen=True)
class LeakPath:
    """A way from wall to wall.

    Attributes
    ----------
    ends : (int, int)
        Vessels it joins, the second `OUTSIDE` of a leak.
    path : (n, 3) float64, mm
        From the first to the second, part frame.
    significance : float
        Distance of its mean evidence from sound gel's, in standard deviations.
    faint : bool
        So much gel is left in it that it is no way of `LEAST_MM`; a crack thinner than the
        averages is such.
    """

    ends: tuple[int, int]
    path: FloatArray
    significance: float
    faint: bool


@dataclass(frozen=True)
class Scene:
    """Design and evidence on one grid.

    Attributes
    ----------
    grid : LumenGrid
    gel : (nz, ny, nx) bool
        Gel by design, clear of walls.
    mean : (nz, ny, nx) float32
        Averaged evidence, NaN out of view.
    told : (nz, ny, nx) bool
        Where gel and liquid can be told apart.
    liquid : float
        Evidence in the lumens.
    clear_mm : float, mm
        From walls to that gel.
    scatter : (nz, ny, nx) float32
        Standard deviation of the averaged evidence in gel.
    """

    grid: LumenGrid
    gel: BoolArray
    mean: NDArray[np.float32]
    told: BoolArray
    liquid: float
    clear_mm: float
    scatter: NDArray[np.float32]

    @property
    def examined(self) -> float:
        """Share of the designed gel that was examined."""
        return float(self.told[self.gel].mean()) if self.gel.any() else 0.0

    def is_gel(self, places: FloatArray) -> BoolArray:
        """Which places (..., 3), mm, are gel by design, clear of walls; none beyond the grid is."""
        index = np.round((places - self.grid.origin_mm) / self.grid.step_mm).astype(np.int64)
        size = np.array(self.gel.shape)
        index = index[..., ::-1]
        within = ((index >= 0) & (index < size)).all(axis=-1)
        index = np.clip(index, 0, size - 1)
        return np.asarray(within & self.gel[tuple(np.moveaxis(index, -1, 0))])


def designed_gel(
    grid: LumenGrid, surface: ModelSurface, model_is_lumen: bool, clear_mm: float
) -> BoolArray:
    """Return where gel is designed at least `clear_mm` (mm) from lumens and from the outside.

    The distance to the outside is looked up at every other voxel and interpolated: it changes by
    no more than the way between them.
    """
    apart = grid.wall_mm > clear_mm
    if model_is_lumen:
        return np.asarray(apart & (grid.wall_mm < grid.reach_mm))
    coarse = np.stack(
        np.meshgrid(*(np.arange(0, size + 1, 2) for size in apart.shape), indexing="ij"), axis=-1
    )
    away = surface.query(grid.places(coarse.reshape(-1, 3))).distance
    return np.asarray(apart & (_doubled(away.reshape(coarse.shape[:-1]), apart.shape) < -clear_mm))


def _doubled(values: FloatArray, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Linear interpolation to twice as many points along each axis."""
    out = values.astype(np.float32)
    for axis, size in enumerate(shape):
        out = np.moveaxis(out, axis, 0)
        fine = np.empty((2 * len(out) - 1, *out.shape[1:]), np.float32)
        fine[::2] = out
        fine[1::2] = (out[:-1] + out[1:]) / 2
        out = np.moveaxis(fine[:size], 0, axis)
    return out


def averaged(
    grid: LumenGrid, evidence: GelEvidence, fit: Fit
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return evidence and its scatter at each voxel of the grid, slab by slab."""
    shape = grid.wall_mm.shape
    mean, scatter = np.empty(shape, np.float32), np.empty(shape, np.float32)
    plane = np.argwhere(np.ones(shape[1:], dtype=np.bool_))
    for k in range(shape[0]):
        places = fit.invert(grid.places(np.c_[np.full(len(plane), k), plane]))
        mean[k] = evidence.at(places).reshape(shape[1:])
        scatter[k] = evidence.scatter_at(places).reshape(shape[1:])
    return mean, scatter


def find_gel_paths(scene: Scene, false_alarm: float) -> list[LeakPath]:
    """Return the ways that sound gel doesn't explain, the surest first, faint ones last."""
    grid = scene.grid
    # In a crotch voxels may be neither: they are the lumen's, not outside.
    beside = scene.clear_mm + 2 * grid.step_mm
    label = np.where(grid.wall_mm <= beside, grid.owner, OUTSIDE).astype(np.int32)
    label[scene.gel] = UNREACHED
    label[(scene.gel & ~scene.told) | ~np.isfinite(scene.mean)] = BARRIER
    mean = np.nan_to_num(scene.mean, nan=1.0)
    cost, length, gel, worst, parent = grow(label, mean, grid.step_mm, MOST_COST)
    met = meetings(label, cost, parent)
    if not len(met):
        return []
    between = 0.5 * mean.ravel()[met].sum(axis=1)
    whole = length.ravel()[met].sum(axis=1) + grid.step_mm
    share = (gel.ravel()[met].sum(axis=1) + grid.step_mm * between) / whole
    # Ways in the dark scatter more than those that tell how much ways scatter.
    scatter = scene.scatter.ravel()[met].mean(axis=1)
    usual = max(float(np.median(scatter)), 1e-6)
    score = _scores(whole, share) / np.maximum(scatter / usual, 1.0)
    least, full = _threshold(len(met), grid.step_mm, false_alarm), mid_evidence(scene.liquid)
    faint = share >= full
    sure = np.where(faint, (score > SURE) & (share < 1 - CRACK * (1 - full)), score > least)
    chosen = np.flatnonzero(sure & (worst.ravel()[met].max(axis=1) < LEADS_THROUGH))
    ways: list[LeakPath] = []
    places = grid.places(np.stack(np.unravel_index(met[:, 0], label.shape), axis=1))
    for one in chosen[np.lexsort((-score[chosen], faint[chosen]))].tolist():
        if all(np.linalg.norm(way.path - places[one], axis=1).min() > APART_MM for way in ways):
            ends, path = _joined(met[one], label, parent, grid)
            ways.append(LeakPath(ends, path, float(score[one]), bool(faint[one])))
    return ways


def mid_evidence(liquid: float) -> float:
    """Return the mean evidence halfway between gel and the axis of a way `LEAST_MM` wide.

    A Gaussian average on the axis of a cylinder of radius r holds 1 - exp(-r²/2σ²) of it.
    """
    within = 1 - np.exp(-((LEAST_MM / 2) ** 2) / (2 * SIGMA_MM**2))
    return float(1 - 0.5 * within * (1 - liquid))


def _threshold(met: int, step: float, false_alarm: float) -> float:
    """Standard deviations beyond which one way in all is chance with that probability.

    Ways count as independent where they meet a resolved area apart, 4 π σ² of the averages; each
    is listed from both sides.
    """
    independent = max(1.0, met * step**2 / (2 * 4 * np.pi * SIGMA_MM**2))
    return float(-ndtri(false_alarm / independent))


def _scores(length: FloatArray, share: FloatArray) -> FloatArray:
    """Standard deviations below the ways of about the same length.

    Median and upper quartile tell the scatter: what is below may be ways that aren't chance. The
    longest ways are often all of them such, for fronts come so far through real ways alone: where
    a length's median lies more than a deviation below the shorter ones', theirs count.
    """
    order = np.argsort(length, kind="stable")
    bins = int(np.clip(len(order) // _LEAST, 1, _BINS))
    out, middle, spread = np.empty(len(order)), -np.inf, 0.0
    for part in np.array_split(order, bins):
        own, upper = np.percentile(share[part], [50, 84.134])
        if own >= middle - spread:
            middle, spread = own, max(upper - own, 1e-3)
        out[part] = (middle - share[part]) / spread
    return out


def _joined(
    pair: IntArray, label: NDArray[np.int32], parent: IntArray, grid: LumenGrid
) -> tuple[tuple[int, int], FloatArray]:
    """Ends and path of the way that meets in a pair of voxels."""
    sides = [_back(int(flat), parent) for flat in pair]
    ends = [int(label.ravel()[flat]) for flat in pair]
    if ends[0] == OUTSIDE or 0 <= ends[1] < ends[0]:
        sides, ends = sides[::-1], ends[::-1]
    flat = np.array(sides[0][::-1] + sides[1])
    path = grid.places(np.stack(np.unravel_index(flat, label.shape), axis=1))
    return (ends[0], ends[1]), path


def _back(flat: int, parent: IntArray) -> list[int]:
    """Voxels from one back to the wall."""
    way = [flat]
    while parent[way[-1]] >= 0:
        way.append(int(parent[way[-1]]))
    return way
