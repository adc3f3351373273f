"""Cut moves into pieces of at most 0.5 mm, the same for all heads, for the needle shaft check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray

PIECE_MM: Final = 0.5
"""No piece is longer, so that squares of the plan may be small."""


@dataclass(frozen=True)
class Pieces:
    """Rows cut up, the same for all heads.

    Attributes
    ----------
    row : (k,) int64
    low, high : (k,) float64
        Shares of the row at which the piece begins and ends.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray

    @staticmethod
    def of(length_mm: FloatArray) -> Pieces:
        """Cut rows of such lengths; one that stands is one piece."""
        count = np.maximum(np.ceil(length_mm / PIECE_MM), 1).astype(np.int64)
        row = np.repeat(np.arange(len(count)), count)
        number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        return Pieces(row, number / count[row], (number + 1) / count[row])

    def of_rows(self, chosen: IntArray) -> Pieces:
        """Some of them, by their numbers."""
        return Pieces(self.row[chosen], self.low[chosen], self.high[chosen])

    def places(self, tips: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Both ends of each piece, (k, 3) mm, of rows' tips (n, 2, 3)."""
        start, step = tips[self.row, 0], (tips[:, 1] - tips[:, 0])[self.row]
        return start + self.low[:, None] * step, start + self.high[:, None] * step

    def values(self, pair: FloatArray) -> FloatArray:
        """A value at rows' ends, (n, 2), at both ends of each piece; inf stays inf."""
        known = np.isfinite(pair[:, 0]) & np.isfinite(pair[:, 1])
        low, high = np.where(known[:, None], pair, 0.0)[self.row].T
        values = np.column_stack([low + self.low * (high - low), low + self.high * (high - low)])
        values[~known[self.row]] = np.inf
        return values
