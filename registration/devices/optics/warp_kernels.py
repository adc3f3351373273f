"""Kernel: resample a volume at mapped positions by trilinear interpolation."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import pjit
from registration.segmentation.volume import trilinear


@pjit
def warp(
    volume: NDArray[np.float32],
    lattice: NDArray[np.float32],
    step: int,
    lost: float,
    out: NDArray[np.float32],
) -> None:
    """Fill `out` (nz, ny, nx) with trilinear values of `volume`, and `lost` where there are none.

    `lattice` (nz, my, mx, 3) holds positions x, y, z in voxels of `volume` for every depth and
    every `step`-th row and column of `out`; between them it is interpolated.
    """
    nz, ny, nx = out.shape
    for z in numba.prange(nz):
        for y in range(ny):
            j = y // step
            v = y / step - j
            for x in range(nx):
                i = x // step
                u = x / step - i
                a, b = (1 - u) * (1 - v), u * (1 - v)
                c, d = (1 - u) * v, u * v
                low, high = lattice[z, j], lattice[z, j + 1]
                px = a * low[i, 0] + b * low[i + 1, 0] + c * high[i, 0] + d * high[i + 1, 0]
                py = a * low[i, 1] + b * low[i + 1, 1] + c * high[i, 1] + d * high[i + 1, 1]
                pz = a * low[i, 2] + b * low[i + 1, 2] + c * high[i, 2] + d * high[i + 1, 2]
                value = trilinear(volume, px, py, pz)
                out[z, y, x] = lost if np.isnan(value) else value
