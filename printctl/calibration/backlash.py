"""Fit an axis' backlash and scale to dial readings taken from both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, fit_line
from printctl.errors import UsageError


@dataclass(frozen=True)
class Backlash:
    """Fitted backlash and scale of one axis.

    Attributes
    ----------
    lost_mm : Estimate
        How much farther the axis stands when it comes from above than from below.
    scale : Estimate
        Travelled over commanded distance.
    scatter_mm : float
        Standard deviation of one reading.
    """

    lost_mm: Estimate
    scale: Estimate
    scatter_mm: float


def fit_backlash(
    target_mm: FloatArray,
    approach: FloatArray,
    measured_mm: FloatArray,
    last_digit_mm: float = 0.0,
) -> Backlash:
    """Fit measured = c + s · target − approach · B/2.

    Parameters
    ----------
    target_mm, measured_mm : (n,) float64
        Commanded place and what the dial says, from any zero.
    approach : (n,) float64
        +1 where the axis came from below, -1 from above.
    last_digit_mm : float, mm
        Of the dial.

    Raises
    ------
    UsageError
        With too few readings, or from one side only.
    """
    if not np.all(np.abs(approach) == 1):
        raise UsageError("approach must be 1 (came from below) or -1 (from above) in every row")
    columns = np.column_stack([np.ones(len(target_mm)), target_mm, -approach / 2])
    fit = fit_line(columns, measured_mm, "backlash", last_digit_mm)
    return Backlash(fit.estimate(2, "mm"), fit.estimate(1, "mm/mm"), fit.residual)
