"""Noise of a vessel's sections, estimated from what a change of the vessel can't touch.

A stenosis over half a vessel widens the spread about the vessel's median, and would hide itself.
Two estimates don't see it: the scatter of a section's own rays, and differences of neighbouring
sections. The larger of both counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

COMMON_UM = 14.4
"""Standard uncertainty of a diameter that all sections share, where no budget states it (type B).

The segmentation moves each wall by an unknown part of the blur; diameters of known lumens came out
up to 25 µm too small, taken as the half width of a rectangular distribution (GUM 4.3.7)."""

_MAD = 1.4826
"""Standard deviation over median absolute deviation, of normal noise."""
_SECOND = np.sqrt(1.5)
"""Standard deviation of x_i - (x_(i-1) + x_(i+1))/2 over that of x, of independent noise."""
_LEAST = 8
"""Differences from which a vessel's own scatter is told; with fewer, all vessels' counts."""


def random_um(errors: Sequence[FloatArray], noise: Sequence[FloatArray]) -> list[FloatArray]:
    """Standard uncertainty of each section of each vessel by noise alone, µm.

    Parameters
    ----------
    errors : sequence of (n,) float64, µm
        Measured less designed diameters of each vessel, in order along it; NaN where closed.
    noise : sequence of (n,) float64, µm
        Standard errors by the scatter of each section's rays; NaN where it has no outline.
    """
    fine = [scatter(error) for error in errors]
    known = [value for value in fine if np.isfinite(value)]
    pooled = float(np.median(known)) if known else 0.0
    return [
        np.asarray(np.fmax(rays, own if np.isfinite(own) else pooled))
        for rays, own in zip(noise, fine, strict=True)
    ]


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
