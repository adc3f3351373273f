"""Tell a scan's levels and blur by the grey values across its round lumens, and measure with them.

Micro-CT and confocal scans have one level of gel and one of liquid. A segmentation, which doesn't
know where lumens are, takes them from all voxels: in thin lumens most voxels are border, so that
their usual value lies between the two, and no voxel tells what the instrument itself blurs. Across
a round lumen of radius R, blurred by σ (instrument, voxels and smoothing together), the share of
gel at the distance ρ from its axis is

    P(ρ) = 1 - F(R² / σ²; 2, ρ² / σ²)

with F the distribution of a non-central χ² of two degrees of freedom: the Gaussian's mass within a
disc. Levels and σ that fit the values across all sections tell each lumen's R by where its wall
was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chndtr, i0e

from kernels.arrays import FloatArray
from registration.alignment.uncertainty import ROOT_TWO_PI
from registration.measuring.gauging.sections import RAYS
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation.volume import GelField

MOST = 120
"""Sections that are looked at, evenly spread."""
GROUPS = 6
"""Of neighbouring sections; what differs between them is chance (delete-a-group jackknife)."""
WITHIN = 10
"""Places from the axis to the wall."""
BEYOND = np.linspace(0.0, 2.5, 6)
"""Places behind the wall, in blurs of the field: 2.5 of them show 0.98 and more of the gel."""
GRID = 0.01
"""Of the coarsest voxel: standard uncertainty of a wall's place by how voxels average, which the
fit takes for a Gaussian. 53 vessels of one print by voxels of 40 µm erred by 0.9 µm RMS where all
else explained 0.6; not tuned on others."""
STEPS = 8
"""Of Newton's method, which starts within a blur of a root without inflection in between."""


@dataclass(frozen=True)
class RoundWalls:
    """Levels and blur of a scan.

    Attributes
    ----------
    liquid, gel : float
        Grey values above the field's level (`GelField.above_level`).
    blur_mm : float, mm
        Standard deviation of all that blurs walls.
    """

    liquid: float
    gel: float
    blur_mm: float

    def share(self, away: FloatArray, radius: FloatArray) -> FloatArray:
        """Share of gel at a distance from the axis of a lumen of some radius, mm."""
        s = self.blur_mm
        return np.asarray(1.0 - chndtr((radius / s) ** 2, 2.0, (away / s) ** 2))

    def radius(self, found: FloatArray) -> FloatArray:
        """Radius of lumens whose walls were found at the field's level, mm."""
        part = -self.liquid / (self.gel - self.liquid)
        true = found.copy()
        for _ in range(STEPS):
            slope = true / self.blur_mm**2 * i0e(true * found / self.blur_mm**2)
            slope *= np.exp(-(((true - found) / self.blur_mm) ** 2) / 2)
            step = (self.share(found, true) - part) / np.maximum(slope, 1e-6 / self.blur_mm)
            true = np.maximum(true + np.clip(step, -self.blur_mm, self.blur_mm), 0.0)
        return true


@dataclass(frozen=True)
class _Samples:
    """Grey values across sections: walls as found (n,), distances and values (n, k)."""

    found: FloatArray
    away: FloatArray
    value: FloatArray

    def __getitem__(self, some: NDArray[np.int64]) -> _Samples:
        return _Samples(self.found[some], self.away[some], self.value[some])

    def misfit(self, at: FloatArray) -> FloatArray:
        """Return the share of gel that levels and ln blur explain less what is seen, (n, k)."""
        walls = _walls(at)
        share = walls.share(self.away, walls.radius(self.found)[:, None])
        return np.asarray(share - (self.value - walls.liquid) / (walls.gel - walls.liquid))

    def fitted(self, start: FloatArray) -> FloatArray:
        """Return liquid, gel, ln blur that explain the values best, weighted by area."""
        weight = np.sqrt(self.away / self.found[:, None])
        unit = start[1] - start[0]

        def off(at: FloatArray) -> FloatArray:
            return np.asarray((weight * self.misfit(at) * (at[1] - at[0]) / unit).ravel())

        return np.asarray(least_squares(off, start, x_scale=[unit, unit, 1.0]).x)


def with_round_walls(
    traces: tuple[VesselTrace, ...], field: GelField
) -> tuple[tuple[VesselTrace, ...], float | None]:
    """Return traces with diameters by the scan's own levels and blur, and their walls' error, mm.

    None, and traces as they were, where too few whole sections tell them, or nothing blurred.
    """
    samples = _sampled(traces, field) if field.blur_mm > 0 else None
    if samples is None:
        return traces, None
    start = np.array([
        min(float(np.median(samples.value[:, 0])), -1e-6),
        max(float(np.median(samples.value[:, -1])), 1e-6),
        np.log(1.2 * field.blur_mm),
    ])  # fmt: skip
    best = samples.fitted(start)
    every = np.arange(len(samples.found))
    others = []
    for group in np.array_split(every, GROUPS):
        rest = samples[np.setdiff1d(every, group)].fitted(best)
        others.append(_walls(rest).radius(samples.found))
    spread = np.sqrt((GROUPS - 1) * np.var(others, axis=0))
    # What no such walls explain at some distance from them moves walls as a wrong level does.
    walls, unexplained = _walls(best), samples.misfit(best).mean(axis=0)
    error = np.hypot(spread, ROOT_TWO_PI * walls.blur_mm * np.sqrt(np.mean(unexplained**2)))
    return (
        tuple(_measured(trace, walls, field.wall_mm) for trace in traces),
        float(np.hypot(np.sqrt(np.mean(error**2)), GRID * field.voxel_mm.max())),
    )


def _walls(fitted: FloatArray) -> RoundWalls:
    return RoundWalls(float(fitted[0]), float(fitted[1]), float(np.exp(fitted[2])))


def _sampled(traces: Sequence[VesselTrace], field: GelField) -> _Samples | None:
    """Grey values across whole sections clear of junctions and ends; None where there are few."""
    chosen = [
        (trace, k)
        for trace in traces
        for k in np.flatnonzero(
            trace.counted & trace.apart & trace.sections.closed_outline
        ).tolist()
    ]
    chosen = chosen[:: -(-len(chosen) // MOST) or 1]
    if len(chosen) < 2 * GROUPS:
        return None
    parts = [_across(trace, k, field) for trace, k in chosen]
    found, away, value = (np.array(column) for column in zip(*parts, strict=True))
    return _Samples(found, away, value)


def _across(trace: VesselTrace, k: int, field: GelField) -> tuple[float, FloatArray, FloatArray]:
    """Wall as found, distances from the axis, and the median value of all rays there."""
    rays = trace.sections.rays[k]
    wall = np.sqrt(np.nanmean(rays**2))
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    way = np.column_stack([np.cos(angle), np.sin(angle)]) @ trace.planes.across[k]
    middle = trace.planes.centre[k] + trace.sections.shift[k] @ trace.planes.across[k]
    inner = np.linspace(0.0, 1.0, WITHIN, endpoint=False)
    own = np.where(np.isfinite(rays), rays, wall)[:, None]
    away = np.hstack([own * inner, own + field.blur_mm * BEYOND])
    value = field.above_level(middle + away[..., None] * way[:, None])
    mean = np.concatenate([wall * inner, wall + field.blur_mm * BEYOND])
    return float(wall), mean, np.nanmedian(value, axis=0)


def _measured(trace: VesselTrace, walls: RoundWalls, further_mm: float) -> VesselTrace:
    """Trace with its open lumens' diameters by these walls, `further_mm` added all round."""
    old = trace.sections
    rays = np.where(np.isfinite(old.rays).any(axis=1, keepdims=True), old.rays, 0.0)
    diameter, median = (
        np.where(d > 0, np.maximum(2 * (walls.radius(wall) + further_mm), 0.0), d)
        for d, wall in (
            (old.diameter, np.sqrt(np.nanmean(rays**2, axis=1))),
            (old.median, np.nanmedian(rays, axis=1)),
        )
    )
    return replace(trace, sections=replace(old, diameter=diameter, median=median))
