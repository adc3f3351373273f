"""Working grid of segmentation: averaging and smoothing of a scan's voxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import Float32Array, FloatArray
from registration.scan import Scan
from registration.segmentation.filters import Weights, binned, gaussian_weights, smooth
from registration.segmentation.volume import Volume


@dataclass(frozen=True)
class Working:
    """Binning and smoothing of one scan.

    Attributes
    ----------
    bins : (bz, by, bx)
        Voxels averaged into one.
    sigma : (3,) float64
        Of the Gaussian along z, y, x, in binned voxels.
    voxel_mm : (3,) float64, mm
        After binning, geometric, as x, y, z.
    origin_mm : (3,) float64, mm
        Centre of the first binned voxel in the scan's frame, as x, y, z.
    blur_mm : float, mm
        Standard deviation of binning (a box of edge v has v²/12) and Gaussian together.
    """

    bins: tuple[int, int, int]
    sigma: FloatArray
    voxel_mm: FloatArray
    origin_mm: FloatArray
    blur_mm: float

    @staticmethod
    def of(scan: Scan, voxel_mm: float, smoothing_mm: float) -> Working:
        """Average to voxels of about `voxel_mm`, smooth by `smoothing_mm`."""
        voxel, counts = np.array(scan.geometric_voxel_mm), bins(scan, voxel_mm)
        size = voxel * counts
        origin = ((size - voxel) / 2)[::-1]
        blur = float(np.sqrt(smoothing_mm**2 + np.mean(size**2) / 12))
        return Working(counts, smoothing_mm / size, size[::-1], origin, blur)

    @property
    def smoothing_mm(self) -> float:
        """Standard deviation of the Gaussian, mm."""
        return float(self.sigma[0] * self.voxel_mm[2])

    def binned(self, scan: Scan) -> Float32Array:
        """Mean linear intensity on the working grid, read slab by slab."""
        return binned(scan, self.bins)

    def smoothed(self, values: Float32Array, part: float = 1.0) -> Float32Array:
        """Gaussian-smoothed copy, by a `part` of the standard deviation."""
        out = np.empty(values.shape, np.float32)
        smooth(values, out, self._weights(part), 0.0)
        return out

    def smoothed_counts(self, values: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """The same in whole counts: half the memory, for scans too large to hold as floats."""
        out = np.empty(values.shape, np.uint16)
        smooth(values, out, self._weights(1.0), 0.5)
        return out

    def _weights(self, part: float) -> Weights:
        z, y, x = (gaussian_weights(part * float(sigma)) for sigma in self.sigma)
        return z, y, x


def bins(scan: Scan, voxel_mm: float) -> tuple[int, int, int]:
    """How many of a scan's voxels along z, y, x make one of about `voxel_mm`."""
    most = np.array(scan.volume.shape) // 8
    counts = np.clip(np.round(voxel_mm / np.array(scan.geometric_voxel_mm)), 1, most)
    bz, by, bx = counts.astype(int).tolist()
    return bz, by, bx


def probe(values: Volume) -> FloatArray:
    """About a million values, evenly spread."""
    flat = values.ravel()
    return flat[:: max(1, flat.size // 1_000_000)].astype(np.float64)
