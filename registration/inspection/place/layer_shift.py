"""Fit a layer's shift (dx, dy) to the sideways offsets measured along its lines."""

from __future__ import annotations

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.inspection.values import Shift

_FEWEST = 8
"""As many as widths are measured from at least."""
PLENTY = 12
"""Fewer offsets tell their own scatter badly: the uncertainty grows by what is lacking."""
_ALONG = 0.01
"""Of the offsets' directions, squared: lines within 6 degrees are as good as straight."""
_TOGETHER = 4.0
"""Neighbouring stations that share noise."""


def fit_shift(
    offset_mm: FloatArray, normal: FloatArray, stroke: IntArray, reach_mm: float, px_mm: float
) -> Shift | None:
    """Return the shift (dx, dy) for which offsets across lines are explained best.

    Huber's weights, so that single displaced lines don't count for all; strokes are taken as
    independent of each other, stations of one aren't. What the lines don't tell (a shift along
    parallel ones) stays 0, with the searched reach as its uncertainty. None for too few offsets.

    Parameters
    ----------
    offset_mm : (m,) float64, mm
        To the left; NaN where not told.
    normal : (m, 2) float64
        To the left.
    stroke : (m,) int64
    reach_mm : float, mm
    px_mm : float, mm
    """
    known = np.isfinite(offset_mm)
    if known.sum() < _FEWEST:
        return None
    a, b, own = normal[known], offset_mm[known], stroke[known]
    weight = np.ones(len(b))
    best: FloatArray = np.zeros(2)
    spread = float(np.median(np.abs(b))) + 1e-9
    for _ in range(10):
        pull = (spread**2 * _TOGETHER / reach_mm**2) * np.eye(2)
        best = np.asarray(np.linalg.solve((a.T * weight) @ a + pull, (a.T * weight) @ b), float)
        off = np.abs(b - a @ best)
        spread = 1.4826 * float(np.median(off)) + 1e-9
        weight = np.minimum(1.0, 1.5 * spread / np.maximum(off, 1e-12))
    spread_of = _covariance(a, b - a @ best, weight, own, spread, reach_mm, px_mm)
    if len(b) < PLENTY:
        spread_of *= (PLENTY / len(b)) ** 2
        share, axes = np.linalg.eigh(a.T @ a / len(b))
        if share[0] < _ALONG:
            slide = axes[:, :1] @ axes[:, :1].T
            best = best - slide @ best
            spread_of = spread_of + reach_mm**2 * slide
    return Shift(float(best[0]), float(best[1]), spread_of)


def _covariance(
    a: FloatArray,
    rest: FloatArray,
    weight: FloatArray,
    stroke: IntArray,
    spread: float,
    reach_mm: float,
    px_mm: float,
) -> FloatArray:
    """The larger of two: by the scatter of stations, by that of strokes; and a part of a pixel."""
    power = (a.T * weight) @ a + (spread**2 * _TOGETHER / reach_mm**2) * np.eye(2)
    inverse = np.linalg.inv(power)
    plain = spread**2 * _TOGETHER * inverse
    _, index = np.unique(stroke, return_inverse=True)
    score = np.zeros((index.max() + 1, 2))
    np.add.at(score, index, (weight * rest)[:, None] * a)
    clustered = inverse @ (score.T @ score) @ inverse
    larger = clustered if np.trace(clustered) > np.trace(plain) else plain
    return np.asarray(larger + (0.05 * px_mm) ** 2 * np.eye(2))
