"""Estimate the measurement noise of values along a vessel, from neighbouring sections."""

from __future__ import annotations

import numpy as np

from kernels.arrays import FloatArray

_MAD = 1.4826
"""Standard deviation over median absolute deviation, of normal noise."""
_SECOND = np.sqrt(1.5)
"""Standard deviation of x_i - (x_(i-1) + x_(i+1))/2 over that of x, of independent noise."""
_LEAST = 8
"""Differences from which a vessel's own scatter is told; with fewer, all vessels' counts."""


def second_differences(values: FloatArray, lag: int = 1) -> FloatArray:
    """Return x_i - (x_(i-lag) + x_(i+lag)) / 2 along the first axis, scaled to the noise of x."""
    inner = values[lag:-lag] - (values[: -2 * lag] + values[2 * lag :]) / 2
    return np.asarray(inner / _SECOND)


def scatter(values: FloatArray, lag: int = 1) -> float:
    """Standard deviation of independent noise, by second differences; NaN where too few."""
    if len(values) < 2 * lag + 1:
        return float("nan")
    fine = second_differences(values, lag)
    fine = fine[np.isfinite(fine)]
    return float(_MAD * np.median(np.abs(fine))) if len(fine) >= _LEAST else float("nan")
