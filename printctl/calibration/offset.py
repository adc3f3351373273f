"""Where one needle's tip stands against another's, from repeated touch-offs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from printctl.calibration.estimate import Estimate, quantile
from printctl.errors import UsageError

FloatArray = NDArray[np.float64]


def fit_offset(first: FloatArray, second: FloatArray) -> tuple[Estimate, Estimate, Estimate]:
    """Offset of the second needle, x, y and z: difference of means, Welch's interval.

    Parameters
    ----------
    first, second : (n, 3), (m, 3) float64, mm
        Where the printer says it is, each time one needle touches the same mark.

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
    x, y, z = (_difference(first[:, axis], second[:, axis]) for axis in range(3))
    return x, y, z


def _difference(first: FloatArray, second: FloatArray) -> Estimate:
    value = float(second.mean() - first.mean())
    parts = [(float(x.var(ddof=1)) / len(x), len(x) - 1) for x in (first, second)]
    variance = sum(part for part, _ in parts)
    if variance == 0:
        return Estimate(value, value, value, "mm")
    dof = variance**2 / sum(part**2 / freedom for part, freedom in parts)
    half = quantile(dof) * math.sqrt(variance)
    return Estimate(value, value - half, value + half, "mm")
