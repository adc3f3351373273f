"""Light over a view, told by what ink doesn't explain: by the ground, and on lines by their rest.

In logarithms light adds. It is a polynomial of second order, robustly fitted, and what is left over
some millimetres.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.values import FloatImage

_LOCAL_MM: Final = 1.2
"""Standard deviation of the filter that follows light beyond a polynomial."""
_PRIOR: Final = 0.05
"""Weight of "nothing beyond the polynomial" where no ground is near."""
_ROUNDS: Final = 4
_OUTLYING: Final = 2.5
"""Spreads from which on a cell hardly counts."""
_CELL_PX: Final = 6


def light_of(rest: FloatImage, weight: FloatImage, px_per_mm: float) -> FloatImage:
    """Return light (h, w, c).

    Parameters
    ----------
    rest : (h, w, c) float32
        Values less what ink adds.
    weight : (h, w) float32
        How much each pixel tells of light, 0 to 1.
    px_per_mm : float
    """
    high, wide = weight.shape
    size = (max(2, wide // _CELL_PX), max(2, high // _CELL_PX))
    share = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    x, y = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    powers = np.column_stack([(x**i * y**j).ravel() for i in range(3) for j in range(3 - i)])
    sigma = _LOCAL_MM * px_per_mm / _CELL_PX
    out = np.empty_like(rest)
    for c in range(rest.shape[2]):
        mean = cv2.resize(rest[:, :, c] * weight, size, interpolation=cv2.INTER_AREA)
        mean /= np.maximum(share, np.float32(1e-3))
        light = _polynomial(mean.ravel(), share.ravel(), powers).reshape(share.shape)
        left = (mean - light) * share
        near = cv2.GaussianBlur(share, (0, 0), sigma) + np.float32(_PRIOR)
        light = light + cv2.GaussianBlur(left.astype(np.float32), (0, 0), sigma) / near
        out[:, :, c] = cv2.resize(
            light.astype(np.float32), (wide, high), interpolation=cv2.INTER_CUBIC
        )
    return out


def _polynomial(values: FloatArray, share: FloatArray, powers: FloatArray) -> FloatArray:
    """Fit by weighted least squares, what lies far off counting less each time."""
    weight = np.where(share > 0.05, share, 0.0).astype(np.float64)
    fit = np.zeros(len(values))
    for _ in range(_ROUNDS):
        rows = (powers * weight[:, None]).T @ powers + 1e-6 * np.eye(powers.shape[1])
        fit = powers @ np.linalg.solve(rows, (powers * weight[:, None]).T @ values)
        rest = np.abs(values - fit)
        told = share > 0.05
        spread = 1.4826 * float(np.median(rest[told])) + 1e-9 if told.any() else 1.0
        weight = np.where(told, share / (1.0 + (rest / (_OUTLYING * spread)) ** 2), 0.0)
    return fit


def telling_pixels(lost: BoolArray, away: FloatImage) -> FloatImage:
    """How much each pixel tells of light before ink is known, (h, w): ground clear of all lines.

    Parameters
    ----------
    lost : (h, w) bool
    away : (h, w) float32, widths
        To the nearest line.
    """
    return np.asarray(~lost & (away > 1.0), dtype=np.float32)
