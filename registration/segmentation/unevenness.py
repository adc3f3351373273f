"""Measure how unevenly bright the gel remains after segmentation's corrections of light.

Inside gel a segmented field is 1 but for speckle. Gel in layers (birefringent collagen under light
of one polarisation, prints of two inks), shadows and haze leave it brighter here and darker there,
over lengths that local levels don't follow; a wall there is held against a level that isn't its
gel's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from registration.segmentation.filters import bin_mean
from registration.segmentation.working import Working

FloatVolume = NDArray[np.float32]

BLOCK_MM = (0.06, 0.3, 0.3)
"""Averaged, z, y, x: layers lie across the light, and speckle is averaged along them."""
DARKEST, SHARE = 0.25, 0.97
"""A block is gel where this share of it lies above that level: dark layers do, liquid doesn't."""
WITHIN = (5, 3, 3)
"""So many blocks about one are gel: 0.12 mm and more from any wall."""
FEWEST = 30
"""Such blocks tell a spread."""


def unevenness(values: FloatVolume, working: Working) -> float:
    """Return the standard deviation of the gel's level beyond speckle, of the step to liquid.

    The spread of blocks, less that between neighbours at the same depth, which is speckle's (and
    robust: layers of one depth make no such difference). 0 where too little gel is thick enough.

    Parameters
    ----------
    values : (nz, ny, nx) float32
        Gel 1, liquid 0.
    working : Working
    """
    wanted = np.maximum(1, np.round(np.array(BLOCK_MM) / working.voxel_mm[::-1])).astype(int)
    block = tuple(np.minimum(wanted, values.shape).tolist())
    full = bin_mean(values > np.float32(DARKEST), block, False, 0.0) > SHARE
    inside = minimum_filter(full.astype(np.uint8), WITHIN, mode="constant") > 0
    level = bin_mean(values, block, False, 0.0)
    if np.count_nonzero(inside) < FEWEST:
        return 0.0
    both = inside[:, :, 1:] & inside[:, :, :-1]
    speckle = _spread(np.diff(level, axis=2)[both]) / np.sqrt(2) if both.any() else 0.0
    return float(np.sqrt(max(_spread(level[inside]) ** 2 - speckle**2, 0.0)))


def _spread(values: NDArray[np.float32]) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
