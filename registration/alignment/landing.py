"""Sides of the part that keep off the design after the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.alignment.fit import Fit, residuals_blurred
from registration.alignment.motion import AXES
from registration.distance import ModelSurface

FloatArray = NDArray[np.float64]

OFF_MM = 0.1
"""A side whose median is off by more contradicts the pose."""
LEAST_SHARE = 0.02
"""A side counts from this share of the points on."""


@dataclass(frozen=True)
class Misfit:
    """Walls that face one way and are off.

    Attributes
    ----------
    words : str
        "the outside facing low z", "walls of lumens facing high x".
    off_mm : float, mm
        Median signed distance, positive outside the solid.
    """

    words: str
    off_mm: float


def misfits(
    surface: ModelSurface, points: FloatArray, fit: Fit, blur_mm: float
) -> tuple[Misfit, ...]:
    """Return the sides that are off by more than `OFF_MM`, the worst first."""
    residual, direction, curved = residuals_blurred(surface, points, fit, blur_mm)
    axis = np.abs(direction).argmax(axis=1)
    high = direction[np.arange(len(axis)), axis] > 0
    out = []
    for k in range(3):
        for upper in (False, True):
            for lumen in (False, True):
                here = (axis == k) & (high == upper) & (curved == lumen)
                if here.mean() < LEAST_SHARE:
                    continue
                off = float(np.median(residual[here]))
                if abs(off) > OFF_MM:
                    what = "curved walls" if lumen else "flat faces"
                    side = f"{'high' if upper else 'low'} {AXES[k]}"
                    out.append(Misfit(f"{what} that face {side}", off))
    return tuple(sorted(out, key=lambda m: -abs(m.off_mm)))
