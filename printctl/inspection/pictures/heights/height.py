"""Make a layer's picture from an OCT volume's slab and surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.inputs import check_lines, check_slab, check_type
from printctl.inspection.pictures.picture import draw_lines
from printctl.inspection.pictures.unmeasured import unmeasured_scans
from printctl.inspection.values import ExpectedLines, FloatImage
from registration.errors import PictureError
from registration.scan import Scan

_SPECKLE_VOXELS: Final = 3
"""Size of the speckle average, each way."""
_MIN_SLAB_VOXELS: Final = 2
"""Least thickness of the averaged slab."""
_SURFACE_LEVEL: Final = 0.5
"""Level of a surface between bath (0) and ink (1)."""
DARK_FLOOR_SHARE: Final = 0.1
"""Offset before the logarithm, relative to the brighter of bath and ink, that suppresses dark
noise."""
_BATH_MARGIN_MM: Final = 1.5
"""Distance from lines within which bath is measured."""
_MIN_PIXELS: Final = 100
"""Least number of pixels for measuring bath or ink."""
_INK_PERCENTILE: Final = 80
"""Percentile of line pixels taken as ink, since some lines may be missing."""
MAX_HEIGHT_THICKNESSES: Final = 2.0
"""Limit of heights over the layer's middle, in thicknesses."""


@dataclass(frozen=True)
class HeightFrame:
    """Mapping from the printer's coordinates to voxels of a scan seen from above.

    Attributes
    ----------
    matrix : (4, 4) float64
        Takes x, y, z, 1 (mm, printer) to column, row, depth (voxels), 1.
    from_above : bool
        Whether the scanner looks down on the print.
    """

    matrix: FloatArray
    from_above: bool = True

    def to_voxels(self, points_mm: FloatArray) -> FloatArray:
        """Return column, row and depth (n, 3) of places (n, 3), mm."""
        points = np.asarray(points_mm, dtype=np.float64)
        return np.asarray(points @ self.matrix[:3, :3].T + self.matrix[:3, 3])

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return column and row (n, 2) of places (n, 3), mm."""
        return self.to_voxels(points_mm)[:, :2]


def height_map(
    scan: Scan,
    to_scan: FloatArray,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines | None = None,
) -> tuple[FloatImage, HeightFrame]:
    """Return a picture (rows, columns, 2) for `see_layer`, and its frame.

    The first channel is the mean intensity (logarithm) of the layer's own slab, the second the
    height of what first sends light back, mm above the layer's middle and no farther from it than
    two thicknesses. What lies between is half of ink and bath of the slab. A-scans of one value
    alone weren't measured: NaN.

    Parameters
    ----------
    scan : Scan
    to_scan : (4, 4) float64
        Takes the printer's places to the scan's frame, mm.
    middle_z_mm, thickness_mm : float, mm
        Of the layer, in the printer's frame.
    lines : ExpectedLines or None
        By which the levels of ink and bath are measured, so that a cropped volume gives the same
        picture as a whole one; without them these are the slab's brightest and darkest values.

    Raises
    ------
    PictureError
        When an argument can't be used, or the slab lies outside the volume.
    """
    check_type(scan, Scan, "scan")
    check_slab(to_scan, middle_z_mm, thickness_mm)
    if lines is not None:
        check_lines(lines)
    dz, dy, dx = scan.geometric_voxel_mm
    matrix = np.diag([1 / dx, 1 / dy, 1 / dz, 1.0]) @ np.asarray(to_scan, dtype=float)
    depth_per_mm = float(matrix[2, 2])
    frame = HeightFrame(matrix, (depth_per_mm < 0) == scan.depth_down)
    if abs(depth_per_mm) < 1e-9:
        raise PictureError("the scan's depth doesn't run along the printer's z; check its frame")
    level = depth_at(frame, middle_z_mm, scan.volume.shape)
    half = max(_MIN_SLAB_VOXELS / 2, 0.5 * thickness_mm * abs(depth_per_mm))
    deepest = scan.volume.shape[0] - 1
    if level.max() + half < 0 or level.min() - half > deepest:
        raise PictureError(
            f"the layer at z {middle_z_mm:g} mm lies at depth {level.mean():.0f} of a volume of "
            f"{deepest + 1} voxels; check the scan's frame"
        )
    unmeasured = unmeasured_scans(scan.volume)
    volume = average_speckle(scan.volume, scan.scale, unmeasured)
    slab = slab_mean(volume, level, half)
    slab[unmeasured] = np.nan
    bath, ink = _bath_and_ink(slab, frame, float(1.0 / np.sqrt(dx * dy)), lines)
    bright = np.log(slab + np.float32(DARK_FLOOR_SHARE * max(bath, ink) + 1e-6))
    edge = np.float32(bath + _SURFACE_LEVEL * (ink - bath))
    height = (_surface(volume, depth_per_mm < 0, edge) - level) / depth_per_mm
    height[unmeasured] = np.nan
    most = MAX_HEIGHT_THICKNESSES * thickness_mm
    return np.stack([bright, np.clip(height, -most, most).astype(np.float32)], axis=2), frame


def depth_at(frame: HeightFrame, z_mm: float | FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the depth, voxels, of a height below columns and rows, (rows, columns)."""
    inverse = np.linalg.inv(frame.matrix)
    column, row = np.meshgrid(np.arange(shape[2]), np.arange(shape[1]))
    # z = inverse[2] . (column, row, depth, 1)
    rest = z_mm - inverse[2, 0] * column - inverse[2, 1] * row - inverse[2, 3]
    return np.asarray(rest / inverse[2, 2])


def average_speckle(volume: NDArray[np.generic], scale: str, unmeasured: BoolArray) -> FloatImage:
    """Average linear intensity over neighbouring measured voxels."""
    out = np.empty(volume.shape, dtype=np.float32)
    size = (_SPECKLE_VOXELS, _SPECKLE_VOXELS)
    share = cv2.blur((~unmeasured).astype(np.float32), size)
    share = np.maximum(share, np.float32(1e-6))
    for k in range(len(volume)):
        slice_ = np.asarray(volume[k], dtype=np.float32)
        light = 10 ** (slice_ / 10) if scale == "db" else slice_
        out[k] = cv2.blur(np.where(unmeasured, np.float32(0.0), light), size) / share
    total = out.copy()
    total[1:] += out[:-1]
    total[:-1] += out[1:]
    total[1:-1] /= 3.0
    total[0] /= 2.0
    total[-1] /= 2.0
    return total


def slab_mean(
    volume: FloatImage | Sequence[FloatImage], level: FloatArray, half: float | FloatArray
) -> FloatImage:
    """Average depths within ``half`` of a level, (rows, columns)."""
    first, last = int(np.floor((level - half).min())), int(np.ceil((level + half).max()))
    total = np.zeros(level.shape, dtype=np.float32)
    weight = np.zeros(level.shape, dtype=np.float32)
    for k in range(max(0, first), min(len(volume) - 1, last) + 1):
        own = np.clip(half + 0.5 - np.abs(k - level), 0.0, 1.0).astype(np.float32)
        total += own * volume[k]
        weight += own
    return np.where(weight > 0.3, total / np.maximum(weight, 1e-6), np.nan).astype(np.float32)


def _bath_and_ink(
    slab: FloatImage, frame: HeightFrame, px_per_mm: float, lines: ExpectedLines | None
) -> tuple[float, float]:
    """Return the slab's mean intensity of bath around lines, and of ink in their middle.

    The area around the lines is fixed, so that cropping the volume doesn't change the levels.
    """
    known = np.isfinite(slab)
    if lines is not None:
        ends = np.stack([frame.to_pixels(lines.start), frame.to_pixels(lines.end)], axis=1)
        wide = lines.width_mm * px_per_mm
        near = draw_lines(slab.shape, ends, wide + 2 * _BATH_MARGIN_MM * px_per_mm) > 0
        taken = draw_lines(slab.shape, ends, 1.7 * wide + 4.0) > 0
        core = draw_lines(slab.shape, ends[lines.fresh], 0.5 * wide[lines.fresh]) > 0
        bath, ink = slab[near & ~taken & known], slab[core & known]
        if min(len(bath), len(ink)) >= _MIN_PIXELS:
            return float(np.median(bath)), float(np.percentile(ink, _INK_PERCENTILE))
    low, high = np.percentile(slab[known], [10, 98]) if known.any() else (0.0, 0.0)
    return float(low), float(high)


def _surface(volume: FloatImage, from_first: bool, level: np.float32) -> FloatImage:
    """Return the depth, voxels, of the first signal from above, (rows, columns)."""
    order = volume if from_first else volume[::-1]
    above = order > level
    first = above.argmax(axis=0)
    rows, columns = np.indices(first.shape)
    before = order[np.maximum(first - 1, 0), rows, columns]
    at = order[first, rows, columns]
    part = np.clip((at - level) / np.maximum(at - before, 1e-6), 0.0, 1.0) * (first > 0)
    depth = np.where(above.any(axis=0), first - part, len(volume) - 1.0).astype(np.float32)
    return depth if from_first else (len(volume) - 1 - depth).astype(np.float32)
