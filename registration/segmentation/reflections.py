"""Bright lines where light meets a wall: told from gel, and taken out.

An index step sends back a line one or two voxels deep. Its peak stands at the wall, but counted as
gel it moves the half level into the liquid by its width times its brightness. Where a line stands
out from the gel, the voxels it covers are taken as missing, and a ramp from the side of liquid to
the side of gel stands in for them, so that the wall comes out at the peak.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import pjit
from registration.segmentation.filters import gaussian_weights, smooth

FloatVolume = NDArray[np.float32]

STANDS_OUT = 1.2
"""A line is brighter than this part of the gel, averaged along the wall."""
LIQUID_SIDE, GEL_SIDE = 0.35, 0.5
"""Beside the line, the mean over `SIDE` voxels is below the first or above the second; upright
walls, which have no line, are neither."""
SIDE = 3
ALONG_VOXELS = 0.8
"""Standard deviation of the average along the wall."""


def without_lines(share: FloatVolume, half: int) -> FloatVolume:
    """Return shares of gel (nz, ny, nx) with reflections of walls taken out.

    Parameters
    ----------
    share : (nz, ny, nx) float32
        1 for gel, speckle and all; changed in place.
    half : int
        Voxels to each side of the peak that a line covers.
    """
    around = np.empty_like(share)
    along, deep = gaussian_weights(ALONG_VOXELS), gaussian_weights(0.0)
    smooth(share, around, (deep, along, along), 0.0)
    _take_out(share, around, half)
    return share


@pjit
def _take_out(share: FloatVolume, around: FloatVolume, half: int) -> None:
    nz, ny, nx = share.shape
    for y in numba.prange(ny):
        for x in range(nx):
            for z in range(half + 1 + SIDE, nz - half - 1 - SIDE):
                peak = around[z, y, x]
                if peak < STANDS_OUT:
                    continue
                if peak < around[z - 1, y, x] or peak <= around[z + 1, y, x]:
                    continue
                above = below = np.float32(0.0)
                for k in range(half + 1, half + 1 + SIDE):
                    above += around[z - k, y, x] / np.float32(SIDE)
                    below += around[z + k, y, x] / np.float32(SIDE)
                if min(above, below) > LIQUID_SIDE or max(above, below) < GEL_SIDE:
                    continue
                above, below = min(above, np.float32(1.0)), min(below, np.float32(1.0))
                for k in range(-half, half + 1):
                    part = np.float32(0.5 + 0.5 * k / (half + 1))
                    share[z + k, y, x] = above + part * (below - above)
