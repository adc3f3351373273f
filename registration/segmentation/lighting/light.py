"""Estimate light at each OCT voxel from the signal summed below it (Vermeer 2014).

Vermeer et al. 2014 (10.1364/BOE.5.000322): what a voxel sends back, I_i, over the light that
still is on its way there is its attenuation coefficient; and that light is what comes back from
below it, plus what leaves the gel unseen:

    light_i = 2 Δ (Σ_{j>i} I_j + I_i / 2) + beyond,   μ_i = I_i / light_i

`beyond` decides how true walls come out, so each A-scan gets two estimates of it:

- from below: in the lowest voxels well within the gel, light is I / μ with the gel's own μ;
- from above: as much light enters here as into the A-scans around.

The first is right where the gel is thick, the second along a steep wall, where an A-scan is
filled in part all the way and has no voxel that is surely gel. They are weighted by their errors.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from kernels import pjit
from kernels.arrays import Float32Array, FloatArray
from registration.segmentation.filters import gaussian_weights, smooth

LOWEST_MM = 0.36
"""So much of the gel's lowest part tells the light from below. Of fewer voxels it would be noisy,
and what is divided by noisy light comes out too bright, most at the bottom."""
ERROR_BELOW = 0.12
"""Relative error of the light from below: the speckle of those, and the typical μ."""
ERROR_ABOVE = 0.03
"""Relative error of the light from above."""
ROUNDS = 2
"""The typical μ's error falls by the light that leaves unseen over what enters: tenfold each."""
EVEN_MM = 0.5
"""The incoming light is taken as even over about this distance."""


def remaining_light(
    signal: Float32Array, step_mm: float, floor: float, pixel_mm: FloatArray, depth_down: bool
) -> tuple[Float32Array, float]:
    """Light at every voxel of an OCT volume whose noise floor has been taken off.

    Parameters
    ----------
    signal : (nz, ny, nx) float32
        Linear intensity.
    step_mm : float, mm
        Geometric depth of a voxel; below 1/(5 μ).
    floor : float
        Signal below this is noise.
    pixel_mm : (2,) float64, mm
        Lateral voxel size, x and y.
    depth_down : bool
        Whether light runs along growing z.

    Returns
    -------
    light : (nz, ny, nx) float32
        ``signal / light`` is the attenuation coefficient in 1/mm.
    typical : float, 1/mm
        That of the gel.
    """
    down = signal if depth_down else signal[::-1]
    light = accumulate(down, step_mm, _first_beyond(down, step_mm, floor, EVEN_MM / pixel_mm[::-1]))
    bright = _brightest(down)
    typical = _typical(bright, down, light)
    within = share_of_gel(down / light, typical) > 0.95
    lowest = max(4, round(LOWEST_MM / step_mm))
    for _ in range(ROUNDS):
        typical = _typical(bright, down, light)
        below, deep, returned = from_below(down, within, step_mm, typical, lowest)
        beyond = _weighted(below, deep, returned, EVEN_MM / pixel_mm[::-1])
        light = accumulate(down, step_mm, np.maximum(beyond, floor / typical))
    return (light if depth_down else light[::-1]), typical


def _first_beyond(
    down: Float32Array, step_mm: float, floor: float, sigma: FloatArray
) -> FloatArray:
    """Light beyond each A-scan, (ny, nx), while nothing is known of the gel.

    As much enters everywhere as comes back where most does, and what doesn't come back goes on: an
    A-scan through liquid alone would else look like gel where the field ends.
    """
    back = 2.0 * step_mm * down.sum(axis=0, dtype=np.float64)
    entering = float(gaussian_filter(back, sigma).max())
    return np.asarray(np.maximum(entering - back, floor))  # at least as if μ were 1/mm there


def share_of_gel(ratio: Float32Array, typical: float, speckle: float = 1.2) -> Float32Array:
    """How much of what is around each voxel is gel: 0.5 at walls, 1 two voxels from any.

    Speckle is smoothed over `speckle` voxels (standard deviation) before anything is decided.
    """
    around, near = gaussian_weights(1.2), gaussian_weights(speckle)
    soft, share = np.empty_like(ratio), np.empty_like(ratio)
    smooth(np.clip(ratio, 0, 2 * typical), soft, (near, near, near), 0.0)
    smooth(soft > 0.5 * typical, share, (around, around, around), 0.0)
    return share


def _brightest(signal: Float32Array) -> NDArray[np.int64]:
    """Flat places of the brightest 10 dB among about a million.

    There the light is strong, and what is unknown beyond the lower end weighs little.
    """
    every = max(1, signal.size // 1_000_000)
    probed = signal.ravel()[::every]
    return np.flatnonzero(probed > 0.1 * np.percentile(probed, 99)) * every


def _typical(bright: NDArray[np.int64], signal: Float32Array, light: Float32Array) -> float:
    """Attenuation of the gel, 1/mm, from these places."""
    return float(np.median(signal.ravel()[bright] / light.ravel()[bright]))


def _weighted(
    below: FloatArray, deep: FloatArray, returned: FloatArray, sigma: FloatArray
) -> FloatArray:
    """Light beyond each A-scan, (ny, nx), from both estimates."""
    solid = (deep > 0) & (deep < 0.2 * returned)
    if not solid.any():
        solid = deep > 0
    entering = np.where(solid, returned + below, 0.0)
    usual = float(np.median(entering[solid])) if solid.any() else float(returned.max())
    share = gaussian_filter(solid.astype(float), sigma)
    around = (gaussian_filter(entering, sigma) + 1e-3 * usual) / (share + 1e-3)
    precise_above = 1.0 / (ERROR_ABOVE * around) ** 2
    precise_below = np.where(deep > 0, 1.0 / (ERROR_BELOW * np.maximum(deep, 1e-12)) ** 2, 0.0)
    above = around - returned
    return np.asarray(
        (above * precise_above + below * precise_below) / (precise_above + precise_below)
    )


@pjit
def accumulate(down: Float32Array, step_mm: float, beyond: FloatArray) -> Float32Array:
    """Sum from below: the light at each voxel, given what lies beyond each A-scan."""
    nz, ny, nx = down.shape
    out = np.empty((nz, ny, nx), dtype=np.float32)
    for y in numba.prange(ny):
        sum_below = np.zeros(nx)
        for step in range(nz):
            z = nz - 1 - step
            for x in range(nx):
                value = down[z, y, x]
                passed = 2.0 * step_mm * max(sum_below[x] + 0.5 * value, 0.0)
                out[z, y, x] = np.float32(passed + beyond[y, x])
                sum_below[x] += value
    return out


@pjit
def from_below(
    down: Float32Array, within: NDArray[np.bool_], step_mm: float, typical: float, lowest: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the `lowest` voxels within the gel say of each A-scan.

    Returns the light beyond, the light at those voxels (0 where there are none), and the light
    that came back from the whole A-scan, (ny, nx) each.
    """
    nz, ny, nx = down.shape
    beyond = np.zeros((ny, nx))
    deep = np.zeros((ny, nx))
    returned = np.zeros((ny, nx))
    for y in numba.prange(ny):
        count = np.zeros(nx, dtype=np.int64)
        for step in range(nz):
            z = nz - 1 - step
            for x in range(nx):
                value = down[z, y, x]
                if count[x] < lowest and within[z, y, x]:
                    count[x] += 1
                    passed = 2.0 * step_mm * returned[y, x] + step_mm * value
                    beyond[y, x] += value / typical - passed
                    deep[y, x] += value / typical
                returned[y, x] += value
        for x in range(nx):
            returned[y, x] *= 2.0 * step_mm
            if count[x] > 0:
                beyond[y, x] /= count[x]
                deep[y, x] /= count[x]
    return beyond, deep, returned
