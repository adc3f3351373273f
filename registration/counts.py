"""Convert integer grey values to dB or to linear intensity, by a linear dB scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class CountLine:
    """dB of a count: ``db = db_at_zero + count / counts_per_db``."""

    counts_per_db: float
    db_at_zero: float

    @property
    def plain(self) -> bool:
        """Whether counts are dB as they stand."""
        return (self.counts_per_db, self.db_at_zero) == (1.0, 0.0)

    def decibels(self, counts: NDArray[np.generic]) -> NDArray[np.float32]:
        """DB of counts, float32."""
        values = counts.astype(np.float32)
        return np.asarray(values / np.float32(self.counts_per_db) + np.float32(self.db_at_zero))

    def intensities(self, kind: np.dtype[np.generic]) -> NDArray[np.float32]:
        """Linear intensity of every count of an integer `kind`, the lowest first."""
        bounds = np.iinfo(kind.name)
        counts = np.arange(bounds.min, bounds.max + 1)
        return np.asarray(np.float32(10.0) ** (self.decibels(counts) * np.float32(0.1)))
