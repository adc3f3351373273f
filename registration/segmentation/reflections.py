"""Distinguish bright wall reflections from gel, and count them as half gel.

An index step sends back many times what gel does, from a line one or two voxels deep where the wall
is smooth, from a band of glints where it is rough. Counted as gel it moves the half level into the
liquid by its width. What outshines the gel's own speckle belongs to a wall, which by definition has
as much gel before as behind: its voxels count as half gel, and the wall comes out at their middle.

How bright speckle gets is asked of gel far from any wall, in averages of several sizes: level walls
show in averages along the wall, glints in single voxels, rough walls in averages of depth too.
Whatever is taken for a line without being one moves walls into the gel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from registration.segmentation.filters import gaussian_weights, near_in_depth, smooth

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]

CHANCE = 1e-3
"""Of the peaks within gel, so many stand out as far as what is taken for a line."""
SCALES = ((0.0, 0.0), (0.8, 0.0), (1.2, 1.0))
"""Standard deviations of the averages along the wall and in depth, voxels."""
DAZZLE = 4.0
"""Times the gel: no voxel counts for more in averages, or a line would spill."""
LEAST = 1.2
"""Times the gel: a line is never fainter."""
INSIDE = 6
"""With gel so many voxels above and below a place has no wall's light: there gel is asked for its
own peaks, and what is bright is a particle."""


def without_lines(share: FloatVolume, gel: Mask, brightest: float) -> FloatVolume:
    """Return shares of gel (nz, ny, nx) with reflections of walls taken for half gel.

    Parameters
    ----------
    share : (nz, ny, nx) float32
        1 for gel, speckle and all; changed in place.
    gel : (nz, ny, nx) bool
        Well within the gel: how far speckle stands out there is no sign of a line.
    brightest : float
        No voxel will count for more than this.
    """
    inside = ~near_in_depth(~gel, INSIDE)
    lines = np.zeros(share.shape, dtype=np.bool_)
    dazzled = np.minimum(share, np.float32(DAZZLE))
    for along, deep in SCALES:
        bright = _smoothed(dazzled, along, deep) if along else share
        lines |= bright >= _stands_out(bright, inside)
    lines &= ~inside
    usual = np.minimum(share[inside], np.float32(brightest))
    share[lines] = 0.5 * float(usual.mean(dtype=np.float64)) if len(usual) else 0.5
    return share


def _smoothed(share: FloatVolume, along: float, deep: float) -> FloatVolume:
    out = np.empty_like(share)
    weights = gaussian_weights(along)
    smooth(share, out, (gaussian_weights(deep), weights, weights), 0.0)
    return out


def _stands_out(bright: FloatVolume, gel: Mask) -> np.float32:
    """Brightness that of gel's own peaks along depth only `CHANCE` exceed, at least `LEAST`."""
    here = bright[1:-1]
    peaks = here[gel[1:-1] & (here > bright[:-2]) & (here > bright[2:])]
    return np.float32(max(float(np.quantile(peaks, 1 - CHANCE)) if len(peaks) else 0.0, LEAST))
