"""Kernel: cast rays across a vessel to find where they leave the lumen."""

from __future__ import annotations

import math

import numba
import numpy as np

from kernels import pjit
from kernels.arrays import FloatArray
from registration.segmentation.volume import Volume, trilinear


@pjit
def first_walls(
    values: Volume,
    sign: float,
    level: float,
    origin: FloatArray,
    voxel: FloatArray,
    centre: FloatArray,
    across: FloatArray,
    shift: FloatArray,
    circle: FloatArray,
    along: FloatArray,
    step: float,
) -> FloatArray:
    """Distance along each ray at which `sign` * value first rises through `level`, (n, r), mm.

    NaN where it doesn't, or only beyond the field. Straight between samples.

    Parameters
    ----------
    values : (nz, ny, nx) float32 or uint16
        Of a field with its `origin` and `voxel` (3,), mm.
    centre, across, shift : (n, 3), (n, 2, 3), (n, 2) float64, mm
        Planes, their directions, and where in them the rays start.
    circle : (r, 2) float64
        Directions of the rays in the planes.
    along : (k,) float64, mm
        Distances that are looked at, `step` from each other.
    """
    out = np.full((len(centre), len(circle)), np.nan)
    for n in numba.prange(len(centre)):
        where = np.empty(3)
        for r in range(len(circle)):
            low = math.nan
            for k in range(len(along)):
                first = shift[n, 0] + along[k] * circle[r, 0]
                second = shift[n, 1] + along[k] * circle[r, 1]
                for c in range(3):
                    place = centre[n, c] + first * across[n, 0, c] + second * across[n, 1, c]
                    where[c] = (place - origin[c]) / voxel[c]
                high = sign * trilinear(values, where[0], where[1], where[2]) - level
                if low < 0.0 and high >= 0.0:
                    out[n, r] = along[k - 1] + step * low / (low - high)
                    break
                low = high
    return out
