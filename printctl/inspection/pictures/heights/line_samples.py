"""Sample points along lines; find upper lines where lines overlap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.pictures.heights.height import HeightFrame
from printctl.inspection.values import ExpectedLines

_STEP_MM: Final = 0.05
"""Distance between samples."""
OVERLAP_WIDTHS: Final = 0.75
"""Half width, in widths, within which an upper line hides a lower one."""
MIN_HEIGHT_DIFFERENCE_WIDTHS: Final = 0.5
"""Least height of the upper line over the lower one, in its widths."""


@dataclass(frozen=True)
class LineSamples:
    """Sample points along lines.

    Attributes
    ----------
    at : (n, 3) float64, mm
    width : (n,) float64, mm
    stroke : (n,) int64
    """

    at: FloatArray
    width: FloatArray
    stroke: IntArray

    @staticmethod
    def of(lines: ExpectedLines, use: BoolArray) -> LineSamples:
        """Sample closely along lines ``use`` (m,)."""
        rows = np.flatnonzero(use)
        length = np.linalg.norm((lines.end - lines.start)[rows], axis=1)
        count = np.maximum(2, np.ceil(length / _STEP_MM).astype(np.int64) + 1)
        own = np.repeat(rows, count)
        number = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
        share = (number / np.repeat(count - 1, count))[:, None]
        at = lines.start[own] * (1 - share) + lines.end[own] * share
        return LineSamples(at, lines.width_mm[own], lines.stroke[own])

    def upper(self, near: IntArray, pixel: FloatArray, frame: HeightFrame) -> IntArray:
        """Replace each column's nearest point (rows, columns) by one that lies over it.

        ``pixel`` (n, 2) is where the picture shows the places.
        """
        out, sign = near.copy(), 1.0 if frame.from_above else -1.0
        px = self.width * np.sqrt(abs(np.linalg.det(frame.matrix[:2, :2])))
        for one in self._over_others(pixel, px, sign):
            low = np.maximum(np.floor(pixel[one] - OVERLAP_WIDTHS * px[one]).astype(int), 0)
            high = np.maximum(np.ceil(pixel[one] + OVERLAP_WIDTHS * px[one]).astype(int) + 1, 0)
            own = out[low[1] : high[1], low[0] : high[0]]
            row, column = np.indices(own.shape)
            away = np.hypot(column + low[0] - pixel[one, 0], row + low[1] - pixel[one, 1])
            above = (
                sign * (self.at[one, 2] - self.at[own, 2])
                > MIN_HEIGHT_DIFFERENCE_WIDTHS * self.width[one]
            )
            other = self.stroke[own] != self.stroke[one]
            own[(away < OVERLAP_WIDTHS * px[one]) & above & other] = one
        return out

    def _over_others(self, pixel: FloatArray, px: FloatArray, sign: float) -> list[int]:
        """Return the points near which the picture shows a lower line, the lowest first."""
        pair = cKDTree(pixel).query_pairs(
            2 * OVERLAP_WIDTHS * float(px.max()), output_type="ndarray"
        )
        pair = pair[self.stroke[pair[:, 0]] != self.stroke[pair[:, 1]]]
        height = sign * self.at[:, 2]
        first = height[pair[:, 0]] > height[pair[:, 1]]
        upper = np.where(first, pair[:, 0], pair[:, 1])
        apart = np.abs(height[pair[:, 0]] - height[pair[:, 1]])
        found = np.unique(upper[apart > MIN_HEIGHT_DIFFERENCE_WIDTHS * self.width[upper]])
        return found[np.argsort(height[found])].tolist()
