"""Noise of vessel sections' centres and walls, from their differences along the vessel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray

_LAG = 3
"""Sections between differences, fewer in a short vessel: closer ones share noise by the blur."""


def middle_noise(middle: FloatArray) -> float:
    """Standard deviation of one coordinate (n, 2), by differences along the vessel."""
    # Of two normal coordinates the squares' sum is exponential: its median is 2 ln 2 variances.
    return float(np.sqrt(np.median((_differences(middle) ** 2).sum(axis=1)) / (2 * np.log(2))))


def wall_spectrum(rays: FloatArray, middle: FloatArray) -> FloatArray:
    """Noise of each harmonic of the wall (n, rays), by differences along the vessel.

    Rays start at the centroid, so that the first harmonic is the centroid's own noise.
    """
    power = np.median(np.abs(_differences(np.fft.rfft(rays, axis=1))) ** 2, axis=0)
    # Real and imaginary part have equal variance: exponential; the mean has one part alone.
    spread = np.sqrt(power / (2 * np.log(2)))
    spread[0] = np.sqrt(power[0] / 0.455)
    spread[1] = middle_noise(middle) * rays.shape[1] / 2
    return np.asarray(spread)


def _differences(values: NDArray[Any]) -> NDArray[Any]:
    """Second differences over (n, k), with the variance of one value: a slope has none."""
    lag = min(_LAG, (len(values) - 1) // 3)
    differences = values[: -2 * lag] - 2 * values[lag:-lag] + values[2 * lag :]
    return np.asarray(differences / np.sqrt(6))
