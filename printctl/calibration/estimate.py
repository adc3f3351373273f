"""Fitted numbers with 95 % intervals, by linear least squares.

Intervals are those of Student's t for residuals that are normal, independent and of one size. They
hold what scatters between readings; a ruler that is wrong by 1 % is wrong by 1 % all the same.

Readings come with the last digit of an instrument, and a few that agree to that digit don't scatter
at all: no reading is therefore taken as better than its last digit q, evenly spread over it, a
variance of q²/12 (JCGM 100:2008, F.2.2.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from kernels.arrays import FloatArray
from printctl.errors import UsageError

LEVEL = 0.95


@dataclass(frozen=True)
class Estimate:
    """A fitted number.

    Attributes
    ----------
    value, low, high : float
        Best value and 95 % interval, in `unit`.
    unit : str
    """

    value: float
    low: float
    high: float
    unit: str = ""

    def text(self) -> str:
        """``12.3 (12.1 to 12.5) mm``, with digits that the interval deserves."""
        width = (self.high - self.low) / 2
        digits = 6
        if math.isfinite(width) and width > 0:
            digits = max(0, min(8, 2 - math.floor(math.log10(width)) - 1))
        numbers = (f"{number:.{digits}f}" for number in (self.value, self.low, self.high))
        value, low, high = numbers
        return f"{value} ({low} to {high}) {self.unit}".rstrip()

    def holds(self, value: float) -> bool:
        """Whether a value lies within the interval."""
        return self.low <= value <= self.high

    def times(self, factor: float, unit: str) -> Estimate:
        """In another unit, by a factor that is known exactly."""
        ends = sorted((self.low * factor, self.high * factor))
        return Estimate(self.value * factor, ends[0], ends[1], unit)


@dataclass(frozen=True)
class LineFit:
    """Least squares of ``y = columns @ values``.

    Attributes
    ----------
    values : (p,) float64
    covariance : (p, p) float64
    dof : int
        Readings less values.
    residual : float
        Standard deviation of one reading: of the residuals, or of its last digit.
    """

    values: FloatArray
    covariance: FloatArray
    dof: int
    residual: float

    def estimate(self, index: int, unit: str) -> Estimate:
        """One of the values."""
        return self.combined(np.eye(len(self.values))[index], unit)

    def combined(self, weights: ArrayLike, unit: str) -> Estimate:
        """A weighted sum of the values."""
        row = np.asarray(weights, dtype=np.float64)
        value = float(row @ self.values)
        half = quantile(self.dof) * math.sqrt(max(0.0, float(row @ self.covariance @ row)))
        return Estimate(value, value - half, value + half, unit)


def quantile(dof: float) -> float:
    """Student's t of the 95 % interval."""
    return float(stdtrit(dof, 0.5 + LEVEL / 2))


def reading_variance(last_digit: float) -> float:
    """Least variance of one reading with that last digit."""
    return last_digit**2 / 12


def fit_line(columns: FloatArray, y: FloatArray, what: str, last_digit: float = 0.0) -> LineFit:
    """Fit a linear model.

    Parameters
    ----------
    columns : (n, p) float64
    y : (n,) float64
    what : str
        For the message.
    last_digit : float
        Of the readings ``y``, in their unit; 0 for exact ones.

    Raises
    ------
    UsageError
        With too few readings, or readings that don't tell the values apart.
    """
    count, unknowns = columns.shape
    if count <= unknowns:
        raise UsageError(
            f"{what}: {count} readings for {unknowns} unknowns leave nothing to judge the fit by; "
            f"take at least {unknowns + 1}, better twice as many"
        )
    scale = np.linalg.norm(columns, axis=0)
    if not scale.all() or np.linalg.matrix_rank(columns / scale, tol=1e-9) < unknowns:
        raise UsageError(
            f"{what}: the readings don't tell the {unknowns} unknowns apart; vary what was set"
        )
    values, *_ = np.linalg.lstsq(columns, y, rcond=None)
    dof = count - unknowns
    variance = max(float(np.sum((y - columns @ values) ** 2)) / dof, reading_variance(last_digit))
    covariance = variance * np.asarray(np.linalg.inv(columns.T @ columns), dtype=np.float64)
    return LineFit(np.asarray(values, dtype=np.float64), covariance, dof, math.sqrt(variance))
