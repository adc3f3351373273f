"""Shift of walls by the cap on bright voxels, from speckle's own law."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, gammaincc

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]


def looks_of(ratio: FloatVolume, gel: Mask) -> float:
    """Looks of the gel's speckle in a voxel: 1 over its relative variance.

    From differences of neighbours three apart, which what changes slowly doesn't touch.
    """
    both = gel[..., 3:] & gel[..., :-3]
    one, other = (side[both][:: max(1, both.size // 2_000_000)]
                  for side in (ratio[..., 3:], ratio[..., :-3]))  # fmt: skip
    if len(one) < 1000:
        return 1.0
    variance = float(((one - other) ** 2).mean(dtype=np.float64)) / 2
    return float(np.clip(one.mean(dtype=np.float64) ** 2 / variance, 1.0, 100.0))


def cap_shift(looks: float, liquid: float, cap: float) -> float:
    """Shift of a wall into the liquid by a cap on voxels, in voxels.

    Voxels at the wall are filled in part. Of speckle with a gamma law of mean m and L looks the
    cap c leaves f(m) = m P(L + 1, c L / m) + c Q(L, c L / m), P and Q the regularised incomplete
    gamma functions; a bent f puts the sum over a wall above halfway between f(q) and f(1).
    """
    mean = np.linspace(liquid, 1.0, 101)
    at = cap * looks / mean
    left = mean * gammainc(looks + 1, at) + cap * gammaincc(looks, at)
    return float((left.mean() - (left[0] + left[-1]) / 2) / (left[-1] - left[0]))
