"""Smooth local mean of selected voxels' values everywhere in a scan, on a coarse grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from registration.segmentation.filters import bin_mean, gaussian_weights, mean_where
from registration.segmentation.walls import smoothed

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]
Factor = tuple[int, int, int]

TREND_RIDGE = 0.05
"""Holds a slope down where all voxels lie in a small part of the neighbourhood's depth."""
FEW = 1e-4
"""Of a neighbourhood: so much weight the usual level has."""


def local_level(
    values: FloatVolume,
    where: Mask,
    factor: Factor,
    sigma: NDArray[np.float64],
    usual: float,
    trend: bool,
) -> FloatVolume:
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
    weight = bin_mean(where, factor, False, 0.0)
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
