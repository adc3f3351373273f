"""Compute the shift of OCT walls that speckle and clipping of bright voxels cause.

Of speckle with a gamma law of mean m and L looks a cap c leaves m P(L + 1, c L / m) +
c Q(L, c L / m), P and Q the regularised incomplete gamma functions. Gel loses more by that than
voxels that a wall fills in part, and walls come out in the liquid. Uncapped, speckle alone puts
them into the gel: it is the stronger the more gel there is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import gammainc, gammaincc, ndtr

from kernels.arrays import FloatArray

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]

FEW, MANY = 1000, 2_000_000
"""Pairs of voxels from which speckle is told, and voxels that are looked at."""
APART = 3
"""Voxels so far from each other have speckle of their own."""
FINE, REACH = 50, 8
"""Steps to a voxel, and voxels to either side, of the profile of a wall."""


def looks_of(ratio: FloatVolume, gel: Mask) -> float:
    """Looks of the gel's speckle in a voxel: 1 over its relative variance.

    From differences of neighbours `APART`, which what changes slowly doesn't touch.
    """
    mean, square = _differences(ratio, gel, 2, APART)
    return float(np.clip(2 * mean**2 / square, 0.3, 100.0)) if square > 0 else 1.0


def edge_of(ratio: FloatVolume, gel: Mask, axis: int) -> float:
    """Standard deviation of the instrument's point spread along an axis, in voxels.

    Fields spread by a Gaussian of s have intensities spread by s / √2, and speckle whose intensity
    at the distance d is correlated by exp(-d² / (2 s²)).
    """
    near, far = (_differences(ratio, gel, axis, apart)[1] for apart in (1, APART))
    alike = float(np.clip(1 - near / far, 1e-3, 0.9)) if far > 0 else 1e-3
    return float(1 / np.sqrt(-4 * np.log(alike)))


def _differences(ratio: FloatVolume, gel: Mask, axis: int, apart: int) -> tuple[float, float]:
    """Mean of gel's voxels, and of their squared differences so far along an axis; 1, 0 of few."""
    across = 0 if axis else 1
    every = max(1, ratio.size // MANY)
    thin = tuple(slice(None, None, every if k == across else 1) for k in range(3))
    value, inside = np.moveaxis(ratio[thin], axis, -1), np.moveaxis(gel[thin], axis, -1)
    both = inside[..., apart:] & inside[..., :-apart]
    one, other = value[..., apart:][both], value[..., :-apart][both]
    if len(one) < FEW:
        return 1.0, 0.0
    return float(one.mean(dtype=np.float64)), float(((one - other) ** 2).mean(dtype=np.float64))


def capped(mean: FloatArray, looks: float, cap: float) -> FloatArray:
    """Mean of speckle of these means that a cap leaves (n,)."""
    mean = np.maximum(mean, 1e-6)
    at = cap * looks / mean
    return np.asarray(mean * gammainc(looks + 1, at) + cap * gammaincc(looks, at))


def cap_shift(looks: float, liquid: float, cap: float) -> float:
    """Shift of a wall into the liquid by a cap on voxels, in voxels, that are filled evenly.

    A bent law puts the sum over a wall above halfway between its ends.
    """
    left = capped(np.linspace(liquid, 1.0, 101), looks, cap)
    return float((left.mean() - (left[0] + left[-1]) / 2) / (left[-1] - left[0]))


def two_caps_shift(
    edge: float,
    smoothing: tuple[float, float],
    looks: tuple[float, float],
    caps: tuple[float, float],
) -> float:
    """Shift of a wall between dark liquid and gel into the liquid, in voxels.

    Parameters
    ----------
    edge : float
        Standard deviation of the point spread (`edge_of`), voxels.
    smoothing : (2,) float
        Of what follows either cap, voxels.
    looks : (2,) float
        Before either cap, within gel.
    caps : (2,) float
        Of gel's mean before any.
    """
    x = np.arange(-REACH * FINE, REACH * FINE + 1) / FINE
    half = 0.5 / edge
    # A voxel that a step under a point spread fills in part: the integral of its profile.
    share = np.mean([ndtr(x / edge + half * u) for u in np.linspace(-1, 1, 21)], axis=0)
    for cap, soft, some in zip(caps, smoothing, looks, strict=True):
        share = gaussian_filter1d(capped(share, some, cap), soft * FINE, mode="nearest")
    return -float(np.interp(share[-1] / 2, share, x))


def speckle_shift(blur: float, contrast: float) -> float:
    """Shift of a wall into the gel by speckle, in the blur's unit: √π σ / contrast².

    A ray meets the level where s δ + n(δ) = 0, s = 1 / (√(2π) σ) the step's rise and n speckle: on
    average at E[n n'] / s². Smoothed, speckle has of the gel's relative variance v = 1 / contrast²
    at x from the wall the part Φ(√2 x / σ): E[n n'] is half of that's slope, v / (2 √π σ).
    """
    return float(np.sqrt(np.pi) * blur / contrast**2)
