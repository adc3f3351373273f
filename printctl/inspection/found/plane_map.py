"""Map working pixels to mm on the layer's plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from printctl.inspection.path_samples import PathSamples
from printctl.inspection.values import Frame

_MARGIN_MM = 2.5
"""Margin of the fit around the layer."""
_POINTS_PER_SIDE = 15


@dataclass(frozen=True)
class PlaneMap:
    """Cubic polynomial from pixels to mm on the layer's plane, fitted to the frame.

    Attributes
    ----------
    middle, scale : (2,) float64, px
        Offset and scale that normalise pixels for the polynomial.
    terms : (10, 2) float64, mm
    px_mm : float, mm
        A pixel, in the middle.
    """

    middle: FloatArray
    scale: FloatArray
    terms: FloatArray
    px_mm: float

    @staticmethod
    def of(frame: Frame, samples: PathSamples, px_mm: float) -> PlaneMap:
        """Fit the polynomial around the layer."""
        low, high = samples.point.min(axis=0), samples.point.max(axis=0)
        x, y = (
            np.linspace(low[k] - _MARGIN_MM, high[k] + _MARGIN_MM, _POINTS_PER_SIDE)
            for k in range(2)
        )
        u, v = (each.ravel() for each in np.meshgrid(x, y))
        points = np.column_stack([u, v, np.full(len(u), np.median(samples.point[:, 2]))])
        pixels = frame.to_pixels(points)
        good = np.isfinite(pixels).all(axis=1)
        pixels, points = pixels[good], points[good]
        middle, scale = pixels.mean(axis=0), np.ptp(pixels, axis=0) / 2 + 1e-9
        terms, *_ = np.linalg.lstsq(_powers((pixels - middle) / scale), points[:, :2], rcond=None)
        return PlaneMap(middle, scale, terms, px_mm)

    def to_printer(self, pixels: FloatArray) -> FloatArray:
        """Return places (n, 2), mm, of working pixels (n, 2)."""
        return np.asarray(_powers((pixels - self.middle) / self.scale) @ self.terms)


def _powers(p: FloatArray) -> FloatArray:
    x, y = p[:, 0], p[:, 1]
    one = np.ones_like(x)
    return np.column_stack([one, x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3])
