"""Light evened out: what the model of light on its way (`light`) leaves uneven in the gel.

That model takes the gel's attenuation as one and what comes back as its share. A focus within the
gel, roll-off, haze and the reflections of flat faces break it by factors of two, and half of a
level that is twice too high is no threshold. The gel itself tells its level, from the places that
are surely gel outwards: round by round, each round reaching as far as the level is known.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from kernels import pjit
from registration.segmentation.filters import between, bin_mean, normalise
from registration.segmentation.light import share_of_gel
from registration.segmentation.local_level import local_level
from registration.segmentation.working import Working

FloatVolume = NDArray[np.float32]

GLARE = 3.0
"""Times the gel around: of speckle 5 % lies above, of a flat face's line all."""
LINE = 2.0
"""Times the gel around: of blocks of `ACROSS_VOXELS` squared no speckle is so bright (one look:
four standard deviations). Such a block is a line, of which nothing is left that outshines gel."""
ACROSS_VOXELS, DEEP_MM = 4, 0.3
"""Blocks of a depth, whose speckle is averaged, and the running median over depth: a line less
than half as deep is gone."""
ROUNDS = 20
"""At most: it ends when no place becomes sure."""
REACH_MM = (0.25, 0.4, 0.4)
"""The level's neighbourhood (standard deviations), z, y, x."""
COARSE_MM = 0.09
SURE = 0.97
"""Share of gel around, for a voxel to tell the gel's level."""
LEAST = 0.2
"""Of the model's level. It is never raised: in a thin sheet the lowest gel, which alone is sure,
may come out brighter than the rest."""


def without_glare(signal: FloatVolume, step_mm: float) -> FloatVolume:
    """Return the signal (nz, ny, nx) with lines far brighter than the gel beside them cut off.

    Beside them is the brighter of what lies above and below: a line at a face has gel on one side.
    """
    nz, ny, nx = signal.shape
    factor = (1, min(ACROSS_VOXELS, ny), min(ACROSS_VOXELS, nx))
    coarse = bin_mean(signal, factor, False, 0.0)
    half = max(2, round(DEEP_MM / step_mm / 2))
    around = np.arange(-half, half + 1)
    middle = np.stack(
        [np.median(coarse[np.clip(z + around, 0, nz - 1)], axis=0) for z in range(nz)]
    )
    beside = maximum_filter1d(middle, 2 * half + 1, axis=0, mode="nearest")
    beside = np.maximum(beside, np.float32(0.0))
    most = np.where(coarse > np.float32(LINE) * beside, np.float32(1.0), np.float32(GLARE))
    return _at_most(signal, most * beside, factor)


@pjit
def _at_most(signal: FloatVolume, most: FloatVolume, factor: tuple[int, int, int]) -> FloatVolume:
    """Lesser of a volume and a level known at every `factor`-th voxel."""
    nz, ny, nx = signal.shape
    out = np.empty_like(signal)
    for z in numba.prange(nz):
        for y in range(ny):
            for x in range(nx):
                out[z, y, x] = min(signal[z, y, x], np.float32(between(most, factor, z, y, x)))
    return out


def evened(signal: FloatVolume, light: FloatVolume, working: Working) -> FloatVolume:
    """Return the signal that gel would send back from each voxel, (nz, ny, nx).

    Parameters
    ----------
    signal : (nz, ny, nx) float32
        Without noise floor and glare.
    light : (nz, ny, nx) float32
        The same by the model alone.
    working : Working
    """
    voxel = working.voxel_mm[::-1]
    wanted = np.maximum(1, np.round(COARSE_MM / voxel)).astype(int)
    z, y, x = np.minimum(wanted, signal.shape).tolist()
    sigma = np.array(REACH_MM) / (voxel * (z, y, x))
    back, sent = (bin_mean(one, (z, y, x), False, 0.0) for one in (signal, light))
    level, known = np.ones_like(back), -1
    for _ in range(ROUNDS):
        share = back / (sent * level)
        gel = share_of_gel(share, 1.0) > SURE
        if np.count_nonzero(gel) == known:
            break
        known = int(np.count_nonzero(gel))
        level *= local_level(share, gel, (1, 1, 1), sigma, 1.0, False)
        np.clip(level, LEAST, 1.0, out=level)
    return np.asarray(light / _over(np.ones_like(light), level, (z, y, x)))


def _over(values: FloatVolume, level: FloatVolume, factor: tuple[int, int, int]) -> FloatVolume:
    """Divide in place by a level known on the coarse grid."""
    normalise(values, np.zeros_like(level), level, factor)
    return values
