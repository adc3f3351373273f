"""Sample a scan, and cut it at a layer's height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray
from registration.overlay.raster import Raster
from registration.scan import Scan
from registration.segmentation import Segmentation
from registration.segmentation.gel_probe import GelProbe

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


@dataclass(frozen=True, eq=False)
class ScanCut:
    """A scan on the pixels of a raster, each (ny, nx).

    Attributes
    ----------
    grey : float32
        The scan's own values, trilinear, in its own scale; NaN beyond the field of view.
    gel : bool
        Where the product's segmentation has gel.
    in_view : bool
        Within the field of view.
    seen : bool
        In view, and light came so deep.
    """

    grey: NDArray[np.float32]
    gel: BoolArray
    in_view: BoolArray
    seen: BoolArray


class Cutter:
    """Cuts one scan at heights of the part.

    Parameters
    ----------
    scan : Scan
    segmentation : Segmentation
        Of that scan.
    scan_to_part : (4, 4) float64
        The pose, mm.
    """

    def __init__(self, scan: Scan, segmentation: Segmentation, scan_to_part: FloatArray) -> None:
        self._scan, self._probe = scan, GelProbe(segmentation, scan.depth_down)
        self._back = np.linalg.inv(scan_to_part)

    def cut(self, raster: Raster, height_mm: float) -> ScanCut:
        """Cut at a height of the part, mm."""
        x, y = np.meshgrid(raster.x_mm, raster.y_mm)
        places = np.stack([x, y, np.full_like(x, height_mm)], axis=-1)
        points = places @ self._back[:3, :3].T + self._back[:3, 3]
        grey, read = trilinear(self._scan, points), self._probe.at(points)
        in_view = np.isfinite(grey)
        return ScanCut(grey, read.gel, in_view, in_view & read.known)
