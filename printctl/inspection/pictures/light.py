"""Estimate and remove the light over a view, and whiten its channels.

In logarithms light adds. It is estimated from the ground, and on lines from what the ink model
leaves: a polynomial of second order, robustly fitted, plus its rest smoothed over some
millimetres. Without light, channels are mixed so that the ground's noise is 1 in each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.pictures.picture import View
from printctl.inspection.values import FloatImage

_LOCAL_SIGMA_MM: Final = 1.2
"""Standard deviation of the Gaussian filter for light beyond the polynomial."""
_POLYNOMIAL_WEIGHT: Final = 0.05
"""Weight of the polynomial alone where no ground is near."""
_ITERATIONS: Final = 4
_OUTLIER_SPREADS: Final = 2.5
"""Spreads at which a cell's weight falls to one half."""
_CELL_PX: Final = 6
"""Side of the cells in which light is estimated."""
_HEIGHT_NOISE_THICKNESSES: Final = 0.05
"""Scatter of heights on the ground, in thicknesses of the layer."""
_INK_WEIGHT: Final = 0.3
"""Weight of pixels with ink in the light's fit, relative to ground."""
_MIN_GROUND_PX: Final = 100
"""Least number of ground pixels for learning noise; below it the whole view is used."""


@dataclass(frozen=True)
class FlatFieldView:
    """View without light, whitened so that the ground is 0 and its noise 1.

    Attributes
    ----------
    view : View
    ground : (h, w) bool
        Pixels that are seen and clear of all lines.
    light : (h, w, c) float32
    mix : (c, c) float64
        Whitening matrix of the channels without light.
    """

    view: View
    ground: BoolArray
    light: FloatImage
    mix: FloatArray

    @staticmethod
    def of(view: View, away: FloatImage) -> FlatFieldView:
        """Estimate the light of a view whose nearest line lies ``away`` (h, w), widths.

        Heights have no light.
        """
        channels, ground = view.channels, ~view.lost & (away > 1.0)
        if view.is_heights:
            return FlatFieldView(
                view, ground, np.zeros_like(channels), np.eye(1) / _HEIGHT_NOISE_THICKNESSES
            )
        light = _light(channels, ground.astype(np.float32), view.px_per_mm)
        rest = channels - light
        mix = _whitening(rest[ground], rest, view.inkless)
        return FlatFieldView(view, ground, light, mix)

    @cached_property
    def image(self) -> FloatImage:
        """The whitened view without light, (h, w, c)."""
        return _mixed(self.view.channels - self.light, self.mix)

    def without_light(self, ink: FloatImage) -> FlatFieldView:
        """Subtract the light that a model of ``ink`` (h, w, c) leaves unexplained."""
        if self.view.is_heights:
            return self
        rest = _mixed(self.image - ink, np.asarray(np.linalg.inv(self.mix)))
        weight = np.where(self.view.lost, 0.0, np.where(self.ground, 1.0, _INK_WEIGHT))
        light = _light(rest, weight.astype(np.float32), self.view.px_per_mm)
        return replace(self, light=self.light + light)


def _whitening(ground: FloatImage, everything: FloatImage, inkless: int) -> FloatArray:
    """Return the matrix (c, c) that makes the ground's noise 1 and independent.

    The first ``inkless`` channels, from the picture before, aren't mixed with the change, in which
    older ink mustn't show.
    """
    count = everything.shape[2]
    own = ground if len(ground) >= _MIN_GROUND_PX else everything.reshape(-1, count)
    low, high = np.percentile(own, [1, 99], axis=0)
    inner = own[((own >= low) & (own <= high)).all(axis=1)]
    cov = np.cov(inner.T).reshape(count, count)
    mix = np.zeros((count, count))
    for part in (slice(0, inkless), slice(inkless, count)):
        block = cov[part, part]
        block = block + (1e-3 * np.trace(block) / max(len(block), 1) + 1e-8) * np.eye(len(block))
        mix[part, part] = np.linalg.inv(np.linalg.cholesky(block))
    return mix


def _mixed(values: FloatImage, mix: FloatArray) -> FloatImage:
    return np.ascontiguousarray(values @ mix.T.astype(np.float32), dtype=np.float32)


def _light(rest: FloatImage, weight: FloatImage, px_per_mm: float) -> FloatImage:
    """Estimate light (h, w, c).

    Parameters
    ----------
    rest : (h, w, c) float32
        Values less what ink adds.
    weight : (h, w) float32
        Weight of each pixel, 0 to 1.
    px_per_mm : float
    """
    high, wide = weight.shape
    size = (max(2, wide // _CELL_PX), max(2, high // _CELL_PX))
    share = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    x, y = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    powers = np.column_stack([(x**i * y**j).ravel() for i in range(3) for j in range(3 - i)])
    sigma = _LOCAL_SIGMA_MM * px_per_mm / _CELL_PX
    out = np.empty_like(rest)
    for c in range(rest.shape[2]):
        mean = cv2.resize(rest[:, :, c] * weight, size, interpolation=cv2.INTER_AREA)
        mean /= np.maximum(share, np.float32(1e-3))
        light = _polynomial(mean.ravel(), share.ravel(), powers).reshape(share.shape)
        left = (mean - light) * share
        near = cv2.GaussianBlur(share, (0, 0), sigma) + np.float32(_POLYNOMIAL_WEIGHT)
        light = light + cv2.GaussianBlur(left.astype(np.float32), (0, 0), sigma) / near
        out[:, :, c] = cv2.resize(
            light.astype(np.float32), (wide, high), interpolation=cv2.INTER_CUBIC
        )
    return out


def _polynomial(values: FloatArray, share: FloatArray, powers: FloatArray) -> FloatArray:
    """Fit a polynomial by iteratively reweighted least squares."""
    weight = np.where(share > 0.05, share, 0.0).astype(np.float64)
    fit = np.zeros(len(values))
    for _ in range(_ITERATIONS):
        rows = (powers * weight[:, None]).T @ powers + 1e-6 * np.eye(powers.shape[1])
        fit = powers @ np.linalg.solve(rows, (powers * weight[:, None]).T @ values)
        rest = np.abs(values - fit)
        known = share > 0.05
        spread = 1.4826 * float(np.median(rest[known])) + 1e-9 if known.any() else 1.0
        weight = np.where(known, share / (1.0 + (rest / (_OUTLIER_SPREADS * spread)) ** 2), 0.0)
    return fit
