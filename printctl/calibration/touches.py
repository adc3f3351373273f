"""Fit backlash, bed and bath planes and needle offsets to dial readings and touches."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, LineFit, fit_line, quantile, reading_variance
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


@dataclass(frozen=True)
class Level:
    """A plane through touched points.

    Attributes
    ----------
    height_mm : Estimate
        At `centre_mm`.
    slope_x, slope_y : Estimate
        Rise per 100 mm.
    flatness_mm : float
        Standard deviation of the points about the plane.
    centre_mm : (x, y)
        Middle of the points.
    """

    height_mm: Estimate
    slope_x: Estimate
    slope_y: Estimate
    flatness_mm: float
    centre_mm: tuple[float, float]
    fit: LineFit

    def rise_mm(self, width_mm: float, depth_mm: float) -> float:
        """Largest difference of height across a part of that size."""
        return (abs(self.slope_x.value) * width_mm + abs(self.slope_y.value) * depth_mm) / 100


def fit_level(
    x_mm: FloatArray,
    y_mm: FloatArray,
    z_mm: FloatArray,
    centre_mm: tuple[float, float] | None = None,
    last_digit_mm: float = 0.0,
) -> Level:
    """Fit z = h + a (x - x₀) + b (y - y₀), z read to ``last_digit_mm``.

    Raises
    ------
    UsageError
        With fewer than four points, or points on one line.
    """
    middle = (float(x_mm.mean()), float(y_mm.mean()))
    x0, y0 = middle if centre_mm is None else centre_mm
    columns = np.column_stack([np.ones(len(x_mm)), x_mm - x0, y_mm - y0])
    fit = fit_line(columns, z_mm, "level", last_digit_mm)
    return Level(
        fit.estimate(0, "mm"),
        fit.estimate(1, "").times(100, "mm per 100 mm"),
        fit.estimate(2, "").times(100, "mm per 100 mm"),
        fit.residual,
        (x0, y0),
        fit,
    )


def gap_between(lower: Level, upper: Level) -> Estimate:
    """Height of one plane above another at their common centre (Welch's degrees of freedom)."""
    parts = [(float(plane.fit.covariance[0, 0]), plane.fit.dof) for plane in (lower, upper)]
    variance = sum(part for part, _ in parts)
    value = upper.height_mm.value - lower.height_mm.value
    if variance == 0:
        return Estimate(value, value, value, "mm")
    dof = variance**2 / sum(part**2 / freedom for part, freedom in parts)
    half = quantile(dof) * math.sqrt(variance)
    return Estimate(value, value - half, value + half, "mm")


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
