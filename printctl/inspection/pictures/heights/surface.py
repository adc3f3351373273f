"""Make a layer's picture from a laser profiler's height map.

A profiler measures nothing where its camera doesn't see the laser's line: behind a taller line, on
steep flanks, where a wet crest mirrors it. Such places are never taken for ink or for none: holes
of a cell or two are filled with what lies around, wider ones are `hidden`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.inputs import (
    PIXEL_LIMITS_MM,
    check_lines,
    check_number,
    check_slab,
    check_type,
)
from printctl.inspection.pictures.heights.height import MAX_HEIGHT_THICKNESSES, HeightFrame
from printctl.inspection.pictures.heights.tilt import BARE_WIDTHS, remove_tilt
from printctl.inspection.pictures.picture import (
    HIGHEST_THICKNESSES,
    LOWEST_THICKNESSES,
    draw_lines,
)
from printctl.inspection.values import ExpectedLines, FloatImage
from registration.errors import PictureError
from registration.files.readers.heights import HeightMap

_FILL_SIGMA_PX: Final = 1.5
"""Standard deviation of the filter that fills unmeasured cells."""
_MAX_CELL_ASPECT: Final = 1.2
"""Largest side of a cell relative to a square one of the same area."""
_MIN_HIDDEN_SHARE: Final = 0.5
"""Share of hidden area from which on a resampled cell is hidden."""
_MIN_WEIGHT: Final = 1e-3
"""Least filter weight for a mean to be defined."""
_RELIEF_GAIN: Final = 6.0
"""Gain of the shaded relief, grey values per Sobel slope."""
_LOST_BGR: Final = (90, 40, 20)
"""Blue, green, red."""


@dataclass(frozen=True)
class Surface:
    """Height map prepared for `see_layer`.

    Attributes
    ----------
    picture : (rows, columns, 2) float32
        Height over the layer's middle: in thicknesses, cut off below the layer; and mm.
    frame : HeightFrame
    hidden : (rows, columns) bool
        Not seen.
    thickness_mm : float, mm
        Of the layer.
    over_top_mm : float, mm
        Usual height of the fresh lines' middles over the layer's top; NaN where none was measured.
    over_ground_mm : float, mm
        Usual height of these middles over the bare surface beside them; NaN where older lines lie
        beside, or none was measured.
    """

    picture: FloatImage
    frame: HeightFrame
    hidden: BoolArray
    thickness_mm: float
    over_top_mm: float
    over_ground_mm: float

    def shaded(self) -> NDArray[Any]:
        """Return the relief lit from the upper left, (rows, columns, 3) uint8; hidden blue."""
        level = self.picture[:, :, 1] / self.thickness_mm
        slope = cv2.Sobel(level, cv2.CV_32F, 1, 0) + cv2.Sobel(level, cv2.CV_32F, 0, 1)
        grey = 110.0 + 60.0 * level - _RELIEF_GAIN * slope
        out = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
        out[self.hidden] = _LOST_BGR
        return out


def surface_of(
    heights: HeightMap,
    to_map: FloatArray,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines,
) -> Surface:
    """Return a layer's surface measured by a profiler.

    Parameters
    ----------
    heights : HeightMap
    to_map : (4, 4) float64
        Takes the printer's places to the profiler's frame, mm; heights grow with the printer's z.
    middle_z_mm, thickness_mm : float, mm
        Of the layer, in the printer's frame.
    lines : ExpectedLines

    Raises
    ------
    PictureError
        When an argument can't be used, or the profiler doesn't look down or measured nothing.
    """
    check_type(heights, HeightMap, "heights")
    check_slab(to_map, middle_z_mm, thickness_mm)
    check_lines(lines)
    for side_mm in heights.pixel_mm:
        check_number(side_mm, "heights: pixel_mm", PIXEL_LIMITS_MM, "mm")
    (dx, dy), (x, y) = heights.pixel_mm, heights.origin_mm
    to_cells = np.diag([1 / dx, 1 / dy, 1.0, 1.0])
    to_cells[:2, 3] = -x / dx, -y / dy
    frame = HeightFrame(to_cells @ np.asarray(to_map, dtype=np.float64))
    if not frame.matrix[2, 2] > 0.5:
        raise PictureError(
            "the profiler's heights don't grow with the printer's z; check printer_to_scan"
        )
    if not np.isfinite(heights.height_mm).any():
        raise PictureError("the profiler measured no height at all")
    above = remove_tilt(_above(heights.height_mm, frame, middle_z_mm), frame, thickness_mm, lines)
    lost = ~np.isfinite(above)
    whole, hidden = _filled(above, lost), lost
    over = _along(lines, frame, above) - thickness_mm / 2
    alone = bool(lines.fresh.all())
    stands = _along(lines, frame, above - _beside(lines, frame, above)) if alone else np.nan
    whole, hidden, to_square = _square(whole, hidden, heights.pixel_mm)
    frame = HeightFrame(to_square @ frame.matrix)
    level = np.clip(whole / thickness_mm, LOWEST_THICKNESSES, HIGHEST_THICKNESSES)
    level[hidden] = LOWEST_THICKNESSES  # a shadow begins where a line ends
    most = MAX_HEIGHT_THICKNESSES * thickness_mm
    picture = np.stack([level, np.clip(whole, -most, most)], axis=2).astype(np.float32)
    return Surface(picture, frame, hidden, thickness_mm, over, stands)


def _square(
    whole: FloatImage, hidden: BoolArray, pixel_mm: tuple[float, float]
) -> tuple[FloatImage, BoolArray, FloatArray]:
    """Resample heights and hidden areas to square cells of equal area; return the (4, 4) matrix.

    Profiles often lie farther apart than points along the laser's line; whoever draws lines into a
    picture, or looks around a place, counts in pixels that are as wide as high.
    """
    side = float(np.sqrt(pixel_mm[0] * pixel_mm[1]))
    by = np.array(pixel_mm) / side
    to_square = np.eye(4)
    if by.max() < _MAX_CELL_ASPECT:
        return whole, hidden, to_square
    rows, columns = whole.shape
    wide, high = max(1, round(columns * by[0])), max(1, round(rows * by[1]))
    # Averaged along one axis first: together both would be interpolated, which leaves points out.
    fewer = (min(columns, wide), min(rows, high))
    planes = [whole, hidden.astype(np.float32)]
    for size, how in ((fewer, cv2.INTER_AREA), ((wide, high), cv2.INTER_LINEAR)):
        planes = [cv2.resize(one, size, interpolation=how) for one in planes]
    by = np.array([wide / columns, high / rows])
    to_square[:2, :2] = np.diag(by)
    to_square[:2, 3] = 0.5 * by - 0.5
    return planes[0], np.asarray(planes[1] > _MIN_HIDDEN_SHARE), to_square


def _above(height_mm: FloatImage, frame: HeightFrame, middle_z_mm: float) -> FloatImage:
    """Return each cell's height over the layer's middle, (rows, columns), mm."""
    _, _, own, offset = np.linalg.inv(frame.matrix)[2]
    across, down = np.linalg.inv(frame.matrix)[2, :2]
    rows, columns = height_mm.shape
    plane = across * np.arange(columns) + down * np.arange(rows)[:, None] + offset - middle_z_mm
    return np.asarray(own * height_mm + plane, dtype=np.float32)


def _beside(lines: ExpectedLines, frame: HeightFrame, above: FloatImage) -> FloatImage:
    """Return the mean bare height beside all lines, (rows, columns); NaN far off."""
    ends = np.stack([frame.to_pixels(lines.start), frame.to_pixels(lines.end)], axis=1)
    px = float(np.hypot(*frame.matrix[:2, 0]) * np.hypot(*frame.matrix[:2, 1])) ** 0.5
    wide = lines.width_mm * px
    bare = (draw_lines(above.shape, ends, BARE_WIDTHS * wide) == 0) & np.isfinite(above)
    reach = BARE_WIDTHS * float(np.median(wide))
    total = cv2.GaussianBlur(np.where(bare, above, np.float32(0.0)), (0, 0), reach)
    share = cv2.GaussianBlur(bare.astype(np.float32), (0, 0), reach)
    return np.asarray(np.where(share > _MIN_WEIGHT, total / np.maximum(share, 1e-6), np.nan))


def _along(lines: ExpectedLines, frame: HeightFrame, above: FloatImage) -> float:
    """Return the median height in the middle of fresh pieces, mm; NaN if unmeasured."""
    middles = 0.5 * (lines.start + lines.end)[lines.fresh]
    column, row = np.rint(frame.to_pixels(middles)).astype(np.int64).T
    rows, columns = above.shape
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    found = above[row[inside], column[inside]]
    found = found[np.isfinite(found)]
    return float(np.median(found)) if len(found) else float("nan")


def _filled(above: FloatImage, lost: BoolArray) -> FloatImage:
    """Remove single spikes, and fill unmeasured cells from around."""
    weight = (~lost).astype(np.float32)
    total = cv2.GaussianBlur(np.where(lost, np.float32(0.0), above), (0, 0), _FILL_SIGMA_PX)
    share = cv2.GaussianBlur(weight, (0, 0), _FILL_SIGMA_PX)
    usual = np.float32(np.median(above[~lost]))
    beside = np.where(share > _MIN_WEIGHT, total / np.maximum(share, _MIN_WEIGHT), usual)
    whole = np.where(lost, beside, above).astype(np.float32)
    return np.asarray(cv2.medianBlur(whole, 3))
