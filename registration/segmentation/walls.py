"""Gel share of each OCT voxel at walls, and its smooth local mean."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import pjit
from kernels.arrays import BoolArray, Float32Array
from registration.segmentation.filters import (
    Weights,
    bin_mean,
    gaussian_weights,
    interpolate_coarse,
    mean_where,
    near_in_depth,
    smooth,
)
from registration.segmentation.working import Working

Factor = tuple[int, int, int]
BESIDE_MM = 0.12
"""How far about beside a wall light is looked for: standard deviation, level."""
ALONG_MM = 0.15
"""Over about this depth it is asked which way a wall leans: standard deviation."""
OWN_MM = 0.3
"""An A-scan with the inside of gel so near above or below has light of its own."""
CLEARLY = 0.02
"""By so much, in that average, the second bound must be less to count alone; less by a part of
that, it counts in part. Upright walls keep the first, whatever the speckle."""
LEAST_WEIGHT = 0.005
"""Of what lies beside, for its light to count."""
STRONG = 0.1
"""Where light is above this part of the strongest, liquid is told from noise."""
_DARKEST, _BRIGHTEST = -3.0, 30.0
"""No share is so far from 0..1 but those of reflections, of which enough is kept to tell them."""


@dataclass(frozen=True)
class Sides:
    """Voxels well within the gel, and well without, (nz, ny, nx) each."""

    gel: BoolArray
    liquid: BoolArray


@dataclass(frozen=True)
class SideLevels:
    """Light in gel or in liquid beside each place, on a coarse grid: times its weight, and that."""

    light: Float32Array
    weight: Float32Array

    @staticmethod
    def of(light: Float32Array, where: BoolArray, factor: Factor, weights: Weights) -> SideLevels:
        """Look around level."""
        return SideLevels(
            smoothed(mean_where(light, where, factor), weights),
            smoothed(bin_mean(where, factor, False), weights),
        )


def share_of_volume(
    signal: Float32Array, light: Float32Array, sides: Sides, working: Working, factor: Factor
) -> tuple[Float32Array, BoolArray]:
    """Share of gel of every voxel, speckle and all, and where that is known.

    Parameters
    ----------
    signal : (nz, ny, nx) float32
        What came back, less the noise.
    light : (nz, ny, nx) float32
        What would have come back of gel under all the light that was there.
    sides : Sides
    working : Working
    factor : (fz, fy, fx)
        The coarse grid's; fz is 1.
    """
    x_mm, y_mm, z_mm = working.voxel_mm
    sigma = BESIDE_MM / (y_mm * factor[1]), BESIDE_MM / (x_mm * factor[2])
    level = gaussian_weights(sigma[0]), gaussian_weights(sigma[1])
    flat = (gaussian_weights(0.0), *level)
    gel = SideLevels.of(light, sides.gel, factor, flat)
    liquid = SideLevels.of(light, sides.liquid, factor, flat)
    scatter = scatter_of_liquid(signal, light, sides.liquid)
    own = near_in_depth(sides.gel, max(1, round(OWN_MM / float(z_mm))))
    upright = _lesser(signal, light, ~own, gel, liquid, scatter, factor)
    upright = smoothed(upright, (gaussian_weights(ALONG_MM / float(z_mm)), *level))
    return _shares(
        signal, light, own, gel.light, gel.weight, liquid.light, liquid.weight, upright, factor,
        scatter,
    )  # fmt: skip


def scatter_of_liquid(signal: Float32Array, light: Float32Array, liquid: BoolArray) -> float:
    """Part of what gel sends back that liquid does, by the same light."""
    every = max(1, signal.size // 1_000_000)
    beam, back = light.ravel()[::every], signal.ravel()[::every]
    known = liquid.ravel()[::every] & (beam > STRONG * np.percentile(beam, 99))
    if np.count_nonzero(known) < 1000:
        return 0.0
    return float(np.clip(np.minimum(back[known] / beam[known], 1.0).mean(), 0.0, 0.5))


def smoothed(values: Float32Array, weights: Weights) -> Float32Array:
    """Gaussian-smoothed copy of a coarse field."""
    out = np.empty_like(values)
    smooth(values, out, weights, 0.0)
    return out


def _lesser(
    signal: Float32Array,
    light: Float32Array,
    steep: BoolArray,
    gel: SideLevels,
    liquid: SideLevels,
    scatter: float,
    factor: Factor,
) -> Float32Array:
    """The second bound less the first, summed over steep walls, on the coarse grid."""
    back, beam = (mean_where(values, steep, factor) for values in (signal, light))
    in_gel = (back - scatter * beam) / (1.0 - scatter)
    both = np.minimum(gel.weight, liquid.weight) > LEAST_WEIGHT
    with np.errstate(divide="ignore", invalid="ignore"):
        first = in_gel * gel.weight / gel.light
        second = bin_mean(steep, factor, False) - (beam - in_gel) * liquid.weight / liquid.light
    return np.where(both, second - first, 0.0).astype(np.float32)


@pjit
def _shares(
    signal: Float32Array,
    light: Float32Array,
    own: BoolArray,
    gel_light: Float32Array,
    gel_weight: Float32Array,
    liquid_light: Float32Array,
    liquid_weight: Float32Array,
    lesser: Float32Array,
    factor: Factor,
    scatter: float,
) -> tuple[Float32Array, BoolArray]:
    """Shares, and where they are known: where there is no gel beside, there is none: 0."""
    nz, ny, nx = signal.shape
    out = np.zeros((nz, ny, nx), dtype=np.float32)
    known = np.empty((nz, ny, nx), dtype=np.bool_)
    for z in numba.prange(nz):
        for y in range(ny):
            for x in range(nx):
                beam = light[z, y, x]
                in_gel = (signal[z, y, x] - scatter * beam) / (1.0 - scatter)
                share = 0.0
                has_share = own[z, y, x]
                if has_share:
                    share = in_gel / beam
                else:
                    weight = interpolate_coarse(gel_weight, factor, z, y, x)
                    has_share = weight > LEAST_WEIGHT
                    if has_share:
                        share = in_gel * weight / interpolate_coarse(gel_light, factor, z, y, x)
                    lead = (
                        -interpolate_coarse(lesser, factor, z, y, x) / CLEARLY if has_share else 0.0
                    )
                    if lead > 0.0:
                        weight = interpolate_coarse(liquid_weight, factor, z, y, x)
                        if weight > LEAST_WEIGHT:
                            passing = interpolate_coarse(liquid_light, factor, z, y, x) / weight
                            second = 1.0 - (beam - in_gel) / passing
                            share += min(lead, 1.0) * (second - share)
                known[z, y, x] = has_share
                out[z, y, x] = np.float32(min(max(share, _DARKEST), _BRIGHTEST))
    return out, known


TREND_RIDGE = 0.05
"""Holds a slope down where all voxels lie in a small part of the neighbourhood's depth."""
FEW = 1e-4
"""Of a neighbourhood: so much weight the usual level has."""


def local_level(
    values: Float32Array,
    where: BoolArray,
    factor: Factor,
    sigma: NDArray[np.float64],
    usual: float,
    trend: bool,
) -> Float32Array:
    """Level of `values` over the voxels `where`, around each place; far from any of them `usual`.

    Parameters
    ----------
    values : (nz, ny, nx) float32
    where : (nz, ny, nx) bool
    factor : (fz, fy, fx)
        Voxels of the coarse grid that the level is given on.
    sigma : (3,) float64
        Of the Gaussian neighbourhood along z, y, x, in coarse voxels.
    usual : float
    trend : bool
        Take the level of a straight line along depth, fitted locally (a local linear regression,
        Fan & Gijbels 1996): at the gel's top and bottom all that is known of it lies to one side,
        and a mean would be the level of a place further in.
    """
    z, y, x = (gaussian_weights(s) for s in sigma)
    weight = bin_mean(where, factor, False)
    total = mean_where(values, where, factor) - np.float32(usual) * weight
    offset = (np.arange(len(z)) - len(z) // 2).astype(np.float32)
    mass, pull = (smoothed(v, (z, y, x)) for v in (weight, total))
    if not trend:
        return np.asarray(usual + pull / (mass + FEW), dtype=np.float32)
    lever, spread = (smoothed(weight, (z * offset**k, y, x)) for k in (1, 2))
    slope = smoothed(total, (z * offset, y, x))
    mass += np.float32(FEW)
    spread += np.float32(TREND_RIDGE * sigma[0] ** 2) * mass
    level = (spread * pull - lever * slope) / (spread * mass - lever**2)
    return np.asarray(usual + level, dtype=np.float32)
