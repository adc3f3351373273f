"""Rasterise a G-code layer: the move covering each pixel, and pixels within a design contour.

A written line is a band of its width with flat ends, round where the next move goes on; so drawn,
bands cover what the G-code's volume fills.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy, prepare

from kernels.arrays import FloatArray
from registration.overlay.lines import LayerLines

Mask = NDArray[np.bool_]

PIXELS_PER_LINE: Final = 6
MOST_PIXELS: Final = 1_000_000
_MARGIN_LINES: Final = 4.0


@dataclass(frozen=True)
class Raster:
    """Square pixels over a part, seen from above.

    Attributes
    ----------
    origin_mm : (float, float), mm
        Centre of pixel (0, 0), x and y, part frame.
    pixel_mm : float, mm
    shape : (ny, nx)
    """

    origin_mm: tuple[float, float]
    pixel_mm: float
    shape: tuple[int, int]

    @staticmethod
    def over(layers: Sequence[LayerLines], line_mm: float) -> Raster:
        """Pixels of a sixth of a line over all layers and a margin; at most a million."""
        ends = np.concatenate([part for one in layers for part in (one.start, one.end)])
        low = ends.min(axis=0) - _MARGIN_LINES * line_mm
        high = ends.max(axis=0) + _MARGIN_LINES * line_mm
        area = float(np.prod(high - low))
        pixel = max(line_mm / PIXELS_PER_LINE, (area / MOST_PIXELS) ** 0.5)
        nx, ny = np.ceil((high - low) / pixel).astype(int).tolist()
        return Raster((float(low[0]) + pixel / 2, float(low[1]) + pixel / 2), pixel, (ny, nx))

    @property
    def x_mm(self) -> FloatArray:
        """Of the pixels' centres, (nx,)."""
        return np.asarray(self.origin_mm[0] + self.pixel_mm * np.arange(self.shape[1]), np.float64)

    @property
    def y_mm(self) -> FloatArray:
        """Of the pixels' centres, (ny,)."""
        return np.asarray(self.origin_mm[1] + self.pixel_mm * np.arange(self.shape[0]), np.float64)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Outer edges: left, right, bottom, top."""
        half, (ny, nx) = self.pixel_mm / 2, self.shape
        x, y = self.origin_mm
        wide, high = self.pixel_mm * nx, self.pixel_mm * ny
        return x - half, x - half + wide, y - half, y - half + high

    def owners(self, layer: LayerLines) -> NDArray[np.int32]:
        """The move whose axis is nearest among those whose band covers each pixel; -1 for none.

        (ny, nx) int32, places in the layer's arrays.
        """
        owner = np.full(self.shape, -1, np.int32)
        nearest = np.full(self.shape, np.inf, np.float32)
        goes_on = np.append(layer.joined[1:], [False])
        for k in range(len(layer.start)):
            where, away = self._band(layer, k, bool(goes_on[k]))
            closer = away < nearest[where]
            nearest[where][closer] = away[closer]
            owner[where][closer] = k
        return owner

    def _band(
        self, layer: LayerLines, k: int, goes_on: bool
    ) -> tuple[tuple[slice, slice], FloatArray]:
        """Pixels about a move, and their distances from its axis; inf outside its band."""
        a, b = layer.start[k], layer.end[k]
        half = float(layer.width_mm[k]) / 2
        where = self._box(np.minimum(a, b) - half, np.maximum(a, b) + half)
        x = self.x_mm[where[1]][None, :] - a[0]
        y = self.y_mm[where[0]][:, None] - a[1]
        length = float(np.hypot(*(b - a)))
        u, v = (b - a) / max(length, 1e-12)
        along, across = x * u + y * v, np.abs(y * u - x * v)
        # A hair more than half, so that no pixel falls between two lines that touch.
        inside = (along >= 0) & (along <= length) & (across <= half + 1e-6)
        away = np.where(inside, across, np.inf)
        if goes_on:
            joint = np.hypot(x - (b - a)[0], y - (b - a)[1])
            away = np.where(joint <= half, np.minimum(away, joint), away)
        return where, away

    def _box(self, low: FloatArray, high: FloatArray) -> tuple[slice, slice]:
        """Rows and columns of the pixels between two corners."""
        first = np.floor((low - self.origin_mm) / self.pixel_mm).astype(int)
        last = np.ceil((high - self.origin_mm) / self.pixel_mm).astype(int) + 1
        (x0, y0), (x1, y1) = np.maximum(first, 0), np.maximum(last, 0)
        return slice(int(y0), int(y1)), slice(int(x0), int(x1))

    def inside(self, rings: Sequence[FloatArray]) -> Mask:
        """Pixels inside closed contours (k, 2), mm, by the even-odd rule, (ny, nx)."""
        inside = np.zeros(self.shape, np.bool_)
        for ring in rings:
            where = self._box(ring.min(axis=0), ring.max(axis=0))
            shape = Polygon(ring)
            prepare(shape)
            x, y = np.meshgrid(self.x_mm[where[1]], self.y_mm[where[0]])
            inside[where] ^= contains_xy(shape, x, y)
        return inside
