"""Make a picture of a layer from a laser profiler's height map: heights, and what it didn't see.

A profiler tells nothing where its camera doesn't see the laser's line: behind a taller line, on
steep flanks, where a wet crest mirrors it. Such places are never taken for ink or for none. Holes
much narrower than a line are filled with the lowest height beside them, since what a shadow hides
lies lower than what throws it; wider ones are `hidden`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from registration.errors import PictureError
from registration.layer_images.height import FARTHEST, HeightFrame
from registration.layer_images.unmeasured import opened
from registration.layer_images.values import BoolArray, ExpectedLines, FloatArray, FloatImage
from registration.readers.heights import HeightMap

_HOLE: Final = 0.4
"""Of a line's width: holes that are as wide each way aren't seen."""
_DEEPEST: Final = 1.5
"""Thicknesses from the layer's middle: how much deeper the ground beside lines lies, or how much
higher something stands, tells nothing of ink."""
_STEEP: Final = 4.0
"""By which slopes are exaggerated in the shaded relief."""
_LOST: Final = (90, 40, 20)
"""Blue, green, red."""


@dataclass(frozen=True)
class Surface:
    """A height map as `see_layer` takes it.

    Attributes
    ----------
    picture : (rows, columns, 2) float32
        Height over the layer's middle: in thicknesses, and mm.
    frame : HeightFrame
    hidden : (rows, columns) bool
        Not seen.
    """

    picture: FloatImage
    frame: HeightFrame
    hidden: BoolArray

    def shaded(self) -> NDArray[Any]:
        """Relief lit from the upper left, (rows, columns, 3) uint8; blue where nothing was seen."""
        level = self.picture[:, :, 0]
        slope = cv2.Sobel(level, cv2.CV_32F, 1, 0) + cv2.Sobel(level, cv2.CV_32F, 0, 1)
        grey = 110.0 + 60.0 * level / _DEEPEST - _STEEP * slope
        out = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
        out[self.hidden] = _LOST
        return out


def surface_of(
    heights: HeightMap,
    to_map: FloatArray,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines,
) -> Surface:
    """Return a layer's surface as a profiler saw it.

    Parameters
    ----------
    heights : HeightMap
    to_map : (4, 4) float64
        Takes the printer's places to the profiler's frame, mm; heights grow with the printer's z.
    middle_z_mm, thickness_mm : float, mm
        Of the layer, in the printer's frame.
    lines : ExpectedLines
        Whose widths say what is a small hole.

    Raises
    ------
    PictureError
        When the profiler doesn't look down, or measured nothing.
    """
    (dx, dy), (x, y) = heights.pixel_mm, heights.origin_mm
    to_cells = np.diag([1 / dx, 1 / dy, 1.0, 1.0])
    to_cells[:2, 3] = -x / dx, -y / dy
    frame = HeightFrame(to_cells @ np.asarray(to_map, dtype=np.float64))
    if not frame.matrix[2, 2] > 0.5:
        raise PictureError(
            "the profiler's heights don't grow with the printer's z; check printer_to_scan"
        )
    above = _above(heights.height_mm, frame, middle_z_mm)
    lost = ~np.isfinite(above)
    if lost.all():
        raise PictureError("the profiler measured no height at all")
    width_px = float(np.percentile(lines.width_mm, 10)) / (dx * dy) ** 0.5
    whole, hidden = _filled(above, lost, width_px)
    own = _DEEPEST * thickness_mm
    level = np.where(hidden, -own, np.clip(whole, -own, own)) / thickness_mm
    most = FARTHEST * thickness_mm
    picture = np.stack([level, np.clip(whole, -most, most)], axis=2).astype(np.float32)
    return Surface(picture, frame, hidden)


def _above(height_mm: FloatImage, frame: HeightFrame, middle_z_mm: float) -> FloatImage:
    """Printer's z of each cell over the layer's middle, (rows, columns), mm."""
    _, _, own, offset = np.linalg.inv(frame.matrix)[2]
    across, down = np.linalg.inv(frame.matrix)[2, :2]
    rows, columns = height_mm.shape
    plane = across * np.arange(columns) + down * np.arange(rows)[:, None] + offset - middle_z_mm
    return np.asarray(own * height_mm + plane, dtype=np.float32)


def _filled(
    above: FloatImage, lost: BoolArray, width_px: float
) -> tuple[FloatImage, BoolArray]:
    """Heights without small holes and single spikes; what is hidden, (rows, columns) each."""
    side = max(2, round(_HOLE * width_px))
    hidden = opened(lost, (side, side))
    high = np.where(lost, np.float32(np.inf), above)
    around = np.ones((2 * side - 1, 2 * side - 1), np.uint8)
    lowest = cv2.erode(high, around, borderType=cv2.BORDER_REPLICATE)
    usual = np.float32(np.median(above[~lost]))
    whole = np.where(lost, np.where(np.isfinite(lowest), lowest, usual), above)
    return np.asarray(cv2.medianBlur(whole.astype(np.float32), 3)), hidden
