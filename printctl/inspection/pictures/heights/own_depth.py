"""Make a picture of an OCT volume's filaments, each at its depth.

One slab over all depths holds more bath than ink where filaments lead up or down, or lie at several
heights. Here each column of the volume is averaged over the height of the filament next to it as
seen from above, relative to what the whole volume usually sends back from that depth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import siegelslopes

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.pictures.heights.height import (
    DARK_FLOOR_SHARE,
    HeightFrame,
    average_speckle,
    depth_at,
    slab_mean,
)
from printctl.inspection.pictures.heights.line_samples import LineSamples
from printctl.inspection.pictures.unmeasured import unmeasured_scans
from printctl.inspection.values import ExpectedLines, FloatImage
from registration.scan import Scan

_MIN_HALF_VOXELS: Final = 1.0
"""Least half height of the average."""
_CORE_HEIGHT_WIDTHS: Final = 0.7
"""Height of the average, in widths of a round filament, whose upper and lower sides are bath."""
_RIM_HEIGHT_FACTOR: Final = 1.6
"""Factor on this height for ink that shows by its upper and lower rim."""
_MIN_CONTRAST_RATIO: Final = 1.5
"""Least contrast of the higher average over the lower one, since it has less noise."""
_MIN_FLOOR_SHARE: Final = 0.05
"""Least offset before the logarithm, relative to the bath."""
_MIN_INK_OVER_BATH: Final = 4.0
"""Least intensity, relative to the bath, of ink used for the fading with depth."""
_MIN_BRIGHT_SAMPLES: Final = 20
"""Least number of points for fitting the fading."""
_MAX_BRIGHT_SAMPLES: Final = 400
"""Number of points used for the fit, about."""


@dataclass(frozen=True)
class ScanByDepth:
    """Volume relative to its usual intensity at each depth.

    Attributes
    ----------
    planes : (depth, rows, columns) float32
        Without speckle; 1 is usual.
    unmeasured : (rows, columns) bool
    """

    planes: FloatImage
    unmeasured: BoolArray

    @staticmethod
    def of(scan: Scan) -> ScanByDepth:
        """Divide each depth by its median."""
        unmeasured = unmeasured_scans(scan.volume)
        planes = average_speckle(scan.volume, scan.scale, unmeasured)
        usual = np.array([np.median(one[~unmeasured]) for one in planes]) if planes.size else 1.0
        planes /= np.maximum(usual, 1e-6 * float(np.max(usual)) + 1e-12)[:, None, None].astype("f4")
        return ScanByDepth(planes, unmeasured)

    def smaller(self, by: float, frame: HeightFrame) -> tuple[ScanByDepth, HeightFrame]:
        """Return a volume of fewer rows and columns, and its frame."""
        rows, columns = self.unmeasured.shape
        size = (max(1, round(columns / by)), max(1, round(rows / by)))
        planes = [cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in self.planes]
        share = cv2.resize(self.unmeasured.astype("f4"), size, interpolation=cv2.INTER_AREA)
        ratio = np.array([size[0] / columns, size[1] / rows, 1.0, 1.0])
        matrix = np.diag(ratio) @ frame.matrix
        matrix[:2, 3] += 0.5 * ratio[:2] - 0.5
        return ScanByDepth(np.stack(planes), np.asarray(share > 0.5)), HeightFrame(matrix)

    def depths(
        self, frame: HeightFrame, places: LineSamples, shape: tuple[int, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Return depths of filaments, and half of the heights to average over, (rows, columns).

        In voxels, of the filament next to each column of a picture of ``shape``; where one lies
        clearly over another, of the one nearer to the scanner, which shades the other.
        """
        column, row = np.meshgrid(*(np.arange(count) for count in shape[::-1]))
        pixel = frame.to_pixels(places.at)
        near = cKDTree(pixel).query(np.column_stack([column.ravel(), row.ravel()]))[1]
        near = places.upper(near.reshape(column.shape), pixel, frame)
        level = depth_at(frame, places.at[near, 2], (len(self.planes), *shape))
        half = 0.5 * _CORE_HEIGHT_WIDTHS * places.width[near] * abs(float(frame.matrix[2, 2]))
        return level, np.maximum(half, _MIN_HALF_VOXELS)

    def along(
        self,
        level: FloatArray,
        half: FloatArray,
        turn: Callable[[NDArray[Any]], NDArray[Any]] = np.asarray,
    ) -> FloatImage:
        """Average each column, turned first, at ``depths``; NaN where nothing was measured."""
        slab = slab_mean([turn(one) for one in self.planes], level, half)
        slab[turn(self.unmeasured)] = np.nan
        return slab


@dataclass(frozen=True)
class TurnedMaps:
    """Pictures of filaments in turned scans.

    Attributes
    ----------
    by_depth : ScanByDepth
    frame : HeightFrame
    lines : ExpectedLines
    use : (n,) bool
        Which of them are followed.
    """

    by_depth: ScanByDepth
    frame: HeightFrame
    lines: ExpectedLines
    use: BoolArray
    _depths: dict[tuple[int, ...], tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    def of(self, turn: Callable[[NDArray[Any]], NDArray[Any]]) -> FloatImage:
        """Return the logarithm at each filament's own depth, (rows, columns)."""
        shape = turn(self.by_depth.unmeasured).shape
        if shape not in self._depths:
            places = LineSamples.of(self.lines, self.use)
            self._depths[shape] = self.by_depth.depths(self.frame, places, shape)
        return np.asarray(
            np.log(self.by_depth.along(*self._depths[shape], turn) + np.float32(DARK_FLOOR_SHARE))
        )


def filament_map(scan: Scan, frame: HeightFrame, lines: ExpectedLines) -> FloatImage:
    """Return a picture (rows, columns, 1) for `see_layer`: logarithm, by the usual at that depth.

    Parameters
    ----------
    scan : Scan
    frame : HeightFrame
        As `height_map` returns it.
    lines : ExpectedLines
        Those written last (``fresh``) are followed.
    """
    places = LineSamples.of(lines, lines.fresh)
    by_depth = ScanByDepth.of(scan)
    level, half = by_depth.depths(frame, places, by_depth.unmeasured.shape)
    at = frame.to_pixels(places.at)
    inner, whole = (
        _logarithm(by_depth.along(level, k * half), level, at) for k in (1.0, _RIM_HEIGHT_FACTOR)
    )
    shown = [_stands_out(one, at) for one in (inner, whole)]
    return (whole if shown[1] > _MIN_CONTRAST_RATIO * shown[0] else inner)[:, :, None]


def _logarithm(slab: FloatImage, level: FloatArray, at: FloatArray) -> FloatImage:
    floor = np.float32(DARK_FLOOR_SHARE) * _ink_level(slab, level, at)
    floor = np.maximum(floor, np.float32(_MIN_FLOOR_SHARE))
    return np.asarray(np.log((slab + floor) / (1 + floor)))


def _stands_out(image: FloatImage, at: FloatArray) -> float:
    """Return the contrast of filaments' middles ``at`` (n, 2) px over the image's scatter."""
    usual = float(np.nanmedian(image))
    spread = float(np.nanmedian(np.abs(image - usual)))
    row, column = _inside(at, image.shape)
    shown = np.abs(image[row, column] - usual)
    known = np.isfinite(shown)
    return float(np.median(shown[known])) / max(spread, 1e-9) if known.any() else 0.0


def _inside(at: FloatArray, shape: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    """Return rows and columns of points (n, 2) px within a picture."""
    column, row = np.rint(at).astype(np.int64).T
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    return row[inside], column[inside]


def _ink_level(slab: FloatImage, level: FloatArray, at: FloatArray) -> FloatImage:
    """Return bright ink's intensity over bath at the depth ``level`` of each column.

    A logarithm without a floor makes the blurred rim of such ink as wide as the ink itself.
    """
    row, column = _inside(at, slab.shape)
    bright = slab[row, column] > _MIN_INK_OVER_BATH
    row, column = row[bright], column[bright]
    if len(row) < _MIN_BRIGHT_SAMPLES:
        return np.zeros_like(slab)
    ink, depth = np.log(slab[row, column]), level[row, column]
    few = slice(None, None, 1 + len(row) // _MAX_BRIGHT_SAMPLES)
    fade = siegelslopes(ink[few], depth[few]) if np.ptp(depth[few]) > 2.0 else None
    slope, begin = (fade.slope, fade.intercept) if fade else (0.0, float(np.median(ink)))
    known = np.clip(level, depth.min(), depth.max())
    return np.exp(begin + slope * known).astype(np.float32)
