"""Fit the offset of one needle's tip from another's, from repeated touch-offs."""

from __future__ import annotations

import math

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, quantile, reading_variance
from printctl.errors import UsageError


def fit_offset(
    first: FloatArray, second: FloatArray, last_digit_mm: float = 0.0
) -> tuple[Estimate, Estimate, Estimate]:
    """Offset of the second needle, x, y and z: difference of means, Welch's interval.

    Parameters
    ----------
    first, second : (n, 3), (m, 3) float64, mm
        Where the printer says it is, each time one needle touches the same mark.
    last_digit_mm : float, mm
        Of its answers.

    Raises
    ------
    UsageError
        With fewer than two touch-offs of either.
    """
    if min(len(first), len(second)) < 2:
        raise UsageError(
            f"{len(first)} and {len(second)} touch-offs; take at least two with each needle, "
            "better five: one alone says nothing of its error"
        )
    x, y, z = (_difference(first[:, axis], second[:, axis], last_digit_mm) for axis in range(3))
    return x, y, z


def _difference(first: FloatArray, second: FloatArray, last_digit: float) -> Estimate:
    value = float(second.mean() - first.mean())
    least = reading_variance(last_digit)
    parts = [(max(float(x.var(ddof=1)), least) / len(x), len(x) - 1) for x in (first, second)]
    variance = sum(part for part, _ in parts)
    if variance == 0:
        return Estimate(value, value, value, "mm")
    dof = variance**2 / sum(part**2 / freedom for part, freedom in parts)
    half = quantile(dof) * math.sqrt(variance)
    return Estimate(value, value - half, value + half, "mm")
