"""Ratio of the RMS misfits of two poses, over the scanned points where they differ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit

CAP_MM = 0.5
"""Deviations count up to this much when poses are compared."""
TELLING_POINTS = 12
"""Fewer points than this don't tell two poses apart."""


def compare_poses(mine: FloatArray, other: FloatArray) -> float:
    """Ratio of RMS distance of the `other` pose to `mine`, over points where they differ.

    Residuals (n,) of the same points under both poses, mm. Only points count whose residuals
    differ by more than five times the spread of the better pose: two poses of a nearly symmetric
    part agree all over but for a mark or two, which an RMS over everything would drown. With
    fewer than a dozen such points the poses can't be told apart: 1.
    """
    telling = _telling(mine, other)
    if telling.sum() < TELLING_POINTS:
        return 1.0
    squares = [float(np.mean(r[telling] ** 2)) for r in _capped(mine, other)]
    return float(np.sqrt(squares[1] / max(squares[0], 1e-12)))


def deviation_where_different(mine: FloatArray, other: FloatArray) -> float:
    """Median deviation, mm, of `mine` at the points by which the two poses are told apart.

    Parameters
    ----------
    mine, other : (n,) float64, mm
        Residuals as of `compare_poses`.
    """
    telling = _telling(mine, other)
    return float(np.median(np.abs(mine[telling]))) if telling.any() else 0.0


def _capped(mine: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.minimum(np.abs(mine), CAP_MM), np.minimum(np.abs(other), CAP_MM)


def _telling(mine: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    spread = 1.4826 * min(float(np.median(np.abs(r))) for r in (mine, other))
    first, second = _capped(mine, other)
    return np.asarray(np.abs(first - second) > 5 * max(spread, 2e-3))


def residuals(surface: ModelSurface, points: FloatArray, fit: Fit) -> FloatArray:
    """Signed distance of the mapped points less the fit's offset, mm."""
    return np.asarray(surface.query(fit.apply(points)).distance - fit.offset_mm)
