"""Turn an OCT volume into a picture of a layer: what scatters in it, and how high it stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from registration.errors import PictureError
from registration.layer_images.values import FloatArray, FloatImage
from registration.scan import Scan

_SPECKLE: Final = 3
"""Voxels over which a surface is looked for, each way."""
_LEAST_SLAB: Final = 2
_EDGE: Final = 0.5
"""Of the way from dark to bright at which a surface lies."""


@dataclass(frozen=True)
class HeightFrame:
    """Where places of the printer lie in a scan seen from above.

    Attributes
    ----------
    matrix : (4, 4) float64
        Takes x, y, z, 1 (mm, printer) to column, row, depth (voxels), 1.
    """

    matrix: FloatArray

    def to_voxels(self, points_mm: FloatArray) -> FloatArray:
        """Return column, row and depth (n, 3) of places (n, 3), mm."""
        points = np.asarray(points_mm, dtype=np.float64)
        return np.asarray(points @ self.matrix[:3, :3].T + self.matrix[:3, 3])

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return column and row (n, 2) of places (n, 3), mm."""
        return self.to_voxels(points_mm)[:, :2]


def height_map(
    scan: Scan, to_scan: FloatArray, middle_z_mm: float, thickness_mm: float
) -> tuple[FloatImage, HeightFrame]:
    """Return a picture (rows, columns, 2) for `see_layer`, and its frame.

    The first channel is the mean intensity (logarithm) of the layer's own slab, the second the
    height of what first sends light back, mm above the layer's middle. Which of them tells ink from
    bath, `see_layer` learns.

    Parameters
    ----------
    scan : Scan
    to_scan : (4, 4) float64
        Takes the printer's places to the scan's frame, mm.
    middle_z_mm, thickness_mm : float, mm
        Of the layer, in the printer's frame.

    Raises
    ------
    PictureError
        When the slab lies outside the volume.
    """
    dz, dy, dx = scan.geometric_voxel_mm
    frame = HeightFrame(np.diag([1 / dx, 1 / dy, 1 / dz, 1.0]) @ np.asarray(to_scan, dtype=float))
    depth_per_mm = float(frame.matrix[2, 2])
    if abs(depth_per_mm) < 1e-9:
        raise PictureError("the scan's depth doesn't run along the printer's z; check its frame")
    level = _depth_of(frame, middle_z_mm, scan.volume.shape)
    half = max(_LEAST_SLAB / 2, 0.5 * thickness_mm * abs(depth_per_mm))
    deepest = scan.volume.shape[0] - 1
    if level.max() + half < 0 or level.min() - half > deepest:
        raise PictureError(
            f"the layer at z {middle_z_mm:g} mm lies at depth {level.mean():.0f} of a volume of "
            f"{deepest + 1} voxels; check the scan's frame"
        )
    volume = _speckle_less(scan.volume)
    slab = _slab_mean(volume, level, half)
    bright = slab if scan.scale == "db" else np.log(slab + _floor(volume))
    height = _surface(volume, depth_per_mm < 0, _gel_level(volume, level, half)) - level
    height = height / depth_per_mm
    return np.stack([bright, height.astype(np.float32)], axis=2), frame


def _depth_of(frame: HeightFrame, z_mm: float, shape: tuple[int, ...]) -> FloatArray:
    """Depth, voxels, of the plane z below each column and row, (rows, columns)."""
    inverse = np.linalg.inv(frame.matrix)
    column, row = np.meshgrid(np.arange(shape[2]), np.arange(shape[1]))
    # z = inverse[2] . (column, row, depth, 1)
    rest = z_mm - inverse[2, 0] * column - inverse[2, 1] * row - inverse[2, 3]
    return np.asarray(rest / inverse[2, 2])


def _speckle_less(volume: NDArray[np.generic]) -> FloatImage:
    """Volume averaged over neighbouring voxels."""
    out = np.empty(volume.shape, dtype=np.float32)
    for k in range(len(volume)):
        out[k] = cv2.blur(np.asarray(volume[k], dtype=np.float32), (_SPECKLE, _SPECKLE))
    total = out.copy()
    total[1:] += out[:-1]
    total[:-1] += out[1:]
    total[1:-1] /= 3.0
    total[0] /= 2.0
    total[-1] /= 2.0
    return total


def _slab_mean(volume: FloatImage, level: FloatArray, half: float) -> FloatImage:
    """Mean over depths within ``half`` of a level, (rows, columns)."""
    first, last = int(np.floor(level.min() - half)), int(np.ceil(level.max() + half))
    total = np.zeros(level.shape, dtype=np.float32)
    weight = np.zeros(level.shape, dtype=np.float32)
    for k in range(max(0, first), min(len(volume) - 1, last) + 1):
        own = np.clip(half + 0.5 - np.abs(k - level), 0.0, 1.0).astype(np.float32)
        total += own * volume[k]
        weight += own
    return np.where(weight > 0.3, total / np.maximum(weight, 1e-6), np.nan).astype(np.float32)


def _floor(volume: FloatImage) -> np.float32:
    """A tenth of what the middle of the volume sends back: dark noise mustn't count."""
    some = volume[:: max(1, len(volume) // 8), ::4, ::4]
    return np.float32(0.1 * max(float(np.median(some)), 1e-6) + 1e-6)


def _gel_level(volume: FloatImage, level: FloatArray, half: float) -> np.float32:
    """Between what the darkest and the brightest parts of the layer's slab send back."""
    first = min(max(0, int(level.min() - half)), len(volume) - 1)
    last = min(max(first + 1, int(np.ceil(level.max() + half))), len(volume))
    low, high = np.percentile(volume[first:last, ::3, ::3], [10, 98])
    return np.float32(low + _EDGE * (high - low))


def _surface(volume: FloatImage, from_first: bool, level: np.float32) -> FloatImage:
    """Depth, voxels, at which light first comes back, looking from above; (rows, columns)."""
    order = volume if from_first else volume[::-1]
    above = order > level
    first = above.argmax(axis=0)
    rows, columns = np.indices(first.shape)
    before = order[np.maximum(first - 1, 0), rows, columns]
    at = order[first, rows, columns]
    part = np.clip((at - level) / np.maximum(at - before, 1e-6), 0.0, 1.0) * (first > 0)
    depth = np.where(above.any(axis=0), first - part, len(volume) - 1.0).astype(np.float32)
    return depth if from_first else (len(volume) - 1 - depth).astype(np.float32)
