"""Find liquid-filled paths through designed gel, with their statistical significance.

From every lumen's wall and from the outside fronts grow through the gel, the faster the less a
place looks like gel (`fronts`). Where two meet they close a way. Its statistic is the mean evidence
for gel along it; what that is in sound gel, search and all, is known from the other ways of the
same scan of about the same length. A way is reported where its mean lies so far below theirs that
a sound scan shows one with the probability `false_alarm`, all places looked at taken together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.topology.fronts import BARRIER, UNREACHED, grow, meetings
from registration.measuring.topology.grid import LumenGrid
from registration.segmentation.evidence import SIGMA_MM, GelEvidence

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
    """

    grid: LumenGrid
    gel: BoolArray
    mean: NDArray[np.float32]
    told: BoolArray
    liquid: float
    clear_mm: float

    @property
    def examined(self) -> float:
        """Share of the designed gel that was examined."""
        return float(self.told[self.gel].mean()) if self.gel.any() else 0.0


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
    score = _scores(whole, share)
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
