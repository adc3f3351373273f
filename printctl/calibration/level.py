"""Fit planes to touched points: tilt of bed and bath surface, and bath depth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, LineFit, fit_line, quantile


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
