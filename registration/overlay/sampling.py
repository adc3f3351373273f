"""Sample a scan at arbitrary positions, and map its values to grey shades."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.scan import Scan

PERCENTILES = (1.0, 99.0)
"""Of the scan's values, shown black and white."""
_SAMPLES = 1_000_000


@dataclass(frozen=True)
class Shades:
    """Which values of a scan are shown black and white, the same in all of its pictures.

    Attributes
    ----------
    low, high : float
        In the scan's own scale, or its root.
    root : bool
        Linear OCT: amplitude. Its logarithm would put a wall, which lies at half the gel's signal,
        outside the place where a picture grows dark.
    """

    low: float
    high: float
    root: bool

    @staticmethod
    def of(scan: Scan) -> Shades:
        """Return the shades of a scan, from a sample of its voxels."""
        steps = [max(1, round((scan.volume.size / _SAMPLES) ** (1 / 3)))] * 3
        some = np.asarray(scan.volume[:: steps[0], :: steps[1], :: steps[2]], dtype=np.float64)
        root = scan.modality == "oct" and scan.scale == "linear"
        values = some[np.isfinite(some)]
        if len(values) == 0:
            return Shades(0.0, 1.0, False)
        values = np.sqrt(np.maximum(values, 0.0)) if root else values
        low, high = np.percentile(values, PERCENTILES)
        return Shades(float(low), float(max(high, low + 1e-12)), root)

    def grey(self, values: NDArray[np.generic]) -> NDArray[np.uint8]:
        """Return values as 0 (black) to 255 (white); black where there is none."""
        plain = np.asarray(values, dtype=np.float64)
        if self.root:
            plain = np.sqrt(np.maximum(plain, 0.0))
        share = (np.nan_to_num(plain, nan=self.low) - self.low) / (self.high - self.low)
        return np.rint(255 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def trilinear(scan: Scan, points: FloatArray) -> NDArray[np.float32]:
    """The scan's own values at (..., 3) positions, mm, scan frame; NaN beyond its voxels.

    Only what is asked for is read, so that a volume that stays in its file may.
    """
    size = np.array(scan.volume.shape[::-1])
    where = points / np.array(scan.geometric_voxel_mm[::-1])
    inside = ((where >= 0) & (where <= size - 1)).all(axis=-1)
    low = np.clip(np.floor(where[inside]).astype(np.int64), 0, size - 2)
    i, j, k = low.T
    part = (where[inside] - low).T
    (u, v, w), total = zip(1 - part, part, strict=True), np.zeros(len(low))
    values = np.asarray(scan.volume)  # a file's map makes a new map of whatever is taken from it
    for a, b, c in np.ndindex(2, 2, 2):
        total += u[a] * v[b] * w[c] * values[k + c, j + b, i + a]
    out = np.full(where.shape[:-1], np.nan, np.float32)
    out[inside] = total
    return out
