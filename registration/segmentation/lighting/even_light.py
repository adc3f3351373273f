"""Correct the OCT light model by the gel's own signal levels, spread outwards from sure gel.

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

from kernels import jit, pjit
from kernels.arrays import Float32Array
from registration.segmentation.filters import bin_mean, times_level
from registration.segmentation.lighting.light import share_of_gel
from registration.segmentation.walls import local_level
from registration.segmentation.working import Working

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
SPECKLE = 0.6
"""Blocks, standard deviation of the average over which gel is told from liquid. They hold a dozen
voxels and more: a wider average takes hazy liquid in a lumen of three blocks for gel."""
SURE = 0.97
"""Share of gel around, for a voxel to tell the gel's level."""
LEAST = 0.2
"""Of the model's level. It is never raised: in a thin sheet the lowest gel, which alone is sure,
may come out brighter than the rest."""


def without_glare(signal: Float32Array, step_mm: float) -> Float32Array:
    """Return the signal (nz, ny, nx) with lines far brighter than the gel beside them cut off.

    Beside them is the brighter of what lies above and below: a line at a face has gel on one side.
    """
    _, ny, nx = signal.shape
    factor = (1, min(ACROSS_VOXELS, ny), min(ACROSS_VOXELS, nx))
    coarse = bin_mean(signal, factor, False)
    half = max(2, round(DEEP_MM / step_mm / 2))
    beside = maximum_filter1d(running_median(coarse, half), 2 * half + 1, axis=0, mode="nearest")
    beside = np.maximum(beside, np.float32(0.0))
    most = np.where(coarse > np.float32(LINE) * beside, np.float32(1.0), np.float32(GLARE))
    return _at_most(signal, most * beside, factor)


@pjit
def running_median(values: Float32Array, half: int) -> Float32Array:
    """Median over depth of each value (nz, ny, nx) and `half` above and below it.

    Beyond the ends lies the nearest value. The window is kept in order: of each step one value
    leaves it and one comes in.
    """
    nz, ny, nx = values.shape
    out = np.empty_like(values)
    for y in numba.prange(ny):
        window = np.empty(2 * half + 1, dtype=values.dtype)
        for x in range(nx):
            window[:] = values[0, y, x]
            for k in range(1, half + 1):
                _replace(window, values[0, y, x], values[min(k, nz - 1), y, x])
            out[0, y, x] = window[half]
            for z in range(1, nz):
                gone = values[max(z - 1 - half, 0), y, x]
                _replace(window, gone, values[min(z + half, nz - 1), y, x])
                out[z, y, x] = window[half]
    return out


@jit
def _replace(window: NDArray[np.float32], gone: float, new: float) -> None:
    """Put `new` in the place of `gone` in an ordered window, and in order again."""
    k = 0
    while k < len(window) - 1 and window[k] != gone:
        k += 1
    while k > 0 and window[k - 1] > new:
        window[k] = window[k - 1]
        k -= 1
    while k < len(window) - 1 and window[k + 1] < new:
        window[k] = window[k + 1]
        k += 1
    window[k] = new


@pjit
def _at_most(
    signal: Float32Array, most: Float32Array, factor: tuple[int, int, int]
) -> Float32Array:
    """Lesser of a volume and a level known at every `factor`-th voxel, as `between` has it."""
    nz, ny, nx = signal.shape
    mz, my, mx = most.shape
    out = np.empty_like(signal)
    place, part = _between_x(mx, nx, factor[2])
    for z in numba.prange(nz):
        c = min(max((z + 0.5) / factor[0] - 0.5, 0.0), mz - 1.0)
        k, w = int(c), c - int(c)
        for y in range(ny):
            b = min(max((y + 0.5) / factor[1] - 0.5, 0.0), my - 1.0)
            j, v = int(b), b - int(b)
            low, low1 = most[k, j], most[k, min(j + 1, my - 1)]
            high, high1 = most[min(k + 1, mz - 1), j], most[min(k + 1, mz - 1), min(j + 1, my - 1)]
            for x in range(nx):
                i, u = place[x], part[x]
                i1 = min(i + 1, mx - 1)
                top = (low[i] * (1 - u) + low[i1] * u) * (1 - v) + (
                    low1[i] * (1 - u) + low1[i1] * u
                ) * v
                end = (high[i] * (1 - u) + high[i1] * u) * (1 - v) + (
                    high1[i] * (1 - u) + high1[i1] * u
                ) * v
                out[z, y, x] = min(signal[z, y, x], np.float32(top * (1 - w) + end * w))
    return out


@jit
def _between_x(count: int, size: int, factor: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Of each of `size` voxels: the coarse one below it, of `count`, and how far it is beyond."""
    place, part = np.empty(size, dtype=np.int64), np.empty(size)
    for x in range(size):
        a = min(max((x + 0.5) / factor - 0.5, 0.0), count - 1.0)
        place[x] = int(a)
        part[x] = a - place[x]
    return place, part


def even_signal(signal: Float32Array, light: Float32Array, working: Working) -> Float32Array:
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
    back, sent = (bin_mean(one, (z, y, x), False) for one in (signal, light))
    level, known = np.ones_like(back), -1
    for _ in range(ROUNDS):
        share = back / (sent * level)
        gel = share_of_gel(share, 1.0, SPECKLE) > SURE
        if np.count_nonzero(gel) == known:
            break
        known = int(np.count_nonzero(gel))
        level *= local_level(share, gel, (1, 1, 1), sigma, 1.0, False)
        np.clip(level, LEAST, 1.0, out=level)
    return times_level(light, level, (z, y, x))
