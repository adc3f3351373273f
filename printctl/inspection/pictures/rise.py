"""Compute the height of ink over the floor it was laid onto.

Over holes of older layers, and beyond their ends, a line sags by up to all that lies below: there
it has ink as long as it stands a layer over the floor, however low its own layer. So heights are
measured over the designed floor, and anything from a layer over it to the layer's own top counts as
all of its ink. Beside an older line that may lie elsewhere the floor is uncertain: there a pixel
that has ink over the one floor and none over the other isn't measured.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.pictures.heights.height import MAX_HEIGHT_THICKNESSES
from printctl.inspection.pictures.picture import (
    HIGHEST_THICKNESSES,
    LAYER_TOP_THICKNESSES,
    LOWEST_THICKNESSES,
    Outlines,
    draw_lines,
)
from printctl.inspection.values import ExpectedLines, FloatImage, Frame, Image
from registration.errors import PictureError

_MAX_ASIDE_WIDTHS: Final = 0.3
"""Distance in widths by which an older line may lie beside its place: lines wander by a tenth of a
millimetre, and a map's older layers aren't registered one by one."""
_CLEAR_WIDTHS: Final = 2.0
"""Width of the band around a line, in widths, beyond which the ground is bare."""
_MIN_GROUND_CELLS: Final = 100
"""Least number of bare cells for measuring the ground's height."""
_COVERED_THICKNESSES: Final = 0.0
"""Height of the ground over the layer's middle, in thicknesses, above which a bath's surface covers
the lines, so that the profiler doesn't see them."""
_MAX_ZERO_ERROR_THICKNESSES: Final = 0.5
"""Error of a profiler's zero, in thicknesses, that is corrected by the ground."""
_MAX_LOWER_THICKNESSES: Final = 1.5
"""Depth of the ground, in thicknesses, up to which a zero error may explain it: ink is then unknown
where no line reaches its layer's middle."""
_MIN_RAISED_SHARE: Final = 0.1
"""Share of line cells above the layer's middle from which on the zero is right."""
_MAX_DIFFERENCE_THICKNESSES: Final = 0.5
"""Largest difference of the rises over two floors, in thicknesses."""
_FLOOR_STEP_THICKNESSES: Final = 0.5
"""Spacing of floor levels, in thicknesses."""


def rise_over_floor(
    picture: Image,
    frame: Frame,
    lines: ExpectedLines,
    thickness_mm: float,
    hidden: Outlines | BoolArray,
) -> tuple[FloatImage, BoolArray]:
    """Return each pixel's rise in its layer, (h, w), and where that is unknown.

    0 on the floor, 1 at the top.

    Parameters
    ----------
    picture : (h, w, 2) float32
        The second channel is height over the layer's middle, mm.
    frame : Frame
    lines : ExpectedLines
    thickness_mm : float, mm
    hidden : sequence of polygons, or (h, w) bool
        As `see_layer` takes it; pixels alone are left out of the ground.

    Raises
    ------
    PictureError
        When the picture isn't a map of heights.
    """
    if picture.ndim != 3 or picture.shape[2] != 2:
        raise PictureError(
            f"thickness_mm is {thickness_mm:g} mm and the picture no height map; leave "
            "thickness_mm out, or give a picture of `height_map` or `surface_of`"
        )
    height: FloatImage = np.asarray(picture[:, :, 1] / thickness_mm, dtype=np.float32)
    ends = np.stack([frame.to_pixels(lines.start), frame.to_pixels(lines.end)], axis=1)
    way = np.linalg.norm((lines.end - lines.start)[:, :2], axis=1)
    scale = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / np.maximum(way, 1e-9)
    wide = float(np.nanmedian(scale[way > 0])) * lines.width_mm
    seen = np.isfinite(height)
    if isinstance(hidden, np.ndarray):
        seen &= ~hidden
    bare = height[seen & (draw_lines(height.shape, ends, _CLEAR_WIDTHS * wide) == 0)]
    ground = float(np.median(bare)) if len(bare) >= _MIN_GROUND_CELLS else LOWEST_THICKNESSES
    if ground > _COVERED_THICKNESSES:
        return np.zeros_like(height), np.ones_like(seen)
    level = _levels(lines, thickness_mm)
    plate = max(
        float(level[~lines.fresh].min(initial=LAYER_TOP_THICKNESSES)) - 1.0, -MAX_HEIGHT_THICKNESSES
    )
    fresh = draw_lines(height.shape, ends[lines.fresh], wide[lines.fresh]) > 0
    none = not (height[seen & fresh] > 0.0).mean() > _MIN_RAISED_SHARE
    if (
        plate > -MAX_HEIGHT_THICKNESSES
        and none
        and _MAX_ZERO_ERROR_THICKNESSES <= plate - ground < _MAX_LOWER_THICKNESSES
    ):
        return np.zeros_like(height), np.ones_like(seen)
    if abs(ground - plate) < _MAX_ZERO_ERROR_THICKNESSES and plate > -MAX_HEIGHT_THICKNESSES:
        height, ground = height - np.float32(ground - plate), plate
    ground = max(ground, plate)
    least, most = _floors(ground, level, ends, wide, ~lines.fresh, height.shape)
    high, low = _over(height, least), _over(height, most)
    return 0.5 * (high + low), ~(high - low <= _MAX_DIFFERENCE_THICKNESSES)


def _over(height: FloatImage, floor: FloatImage) -> FloatImage:
    """Return ink over a floor: one layer, or up to the layer's top, is 1; more is added on top."""
    whole = np.minimum(LAYER_TOP_THICKNESSES - floor, 1.0)
    part = np.clip((height - floor) / whole, 0.0, 1.0)
    return np.asarray(
        part
        + np.clip(height - LAYER_TOP_THICKNESSES, 0.0, HIGHEST_THICKNESSES - LAYER_TOP_THICKNESSES),
        dtype=np.float32,
    )


def _levels(lines: ExpectedLines, thickness_mm: float) -> FloatArray:
    """Return designed tops of lines over the layer's middle, thicknesses, (n,)."""
    z = 0.5 * (lines.start + lines.end)[:, 2]
    off = (z - np.median(z[lines.fresh])) / thickness_mm
    return np.asarray(
        _FLOOR_STEP_THICKNESSES * np.rint(off / _FLOOR_STEP_THICKNESSES) + LAYER_TOP_THICKNESSES
    )


def _floors(
    ground: float,
    level: FloatArray,
    ends: FloatArray,
    wide: FloatArray,
    old: BoolArray,
    shape: tuple[int, int],
) -> tuple[FloatImage, FloatImage]:
    """Return lowest and highest possible floor of each pixel, thicknesses over the middle.

    Holes between older lines that are narrower than their possible offset are ignored.
    """
    level = np.minimum(level, LOWEST_THICKNESSES)
    aside = _MAX_ASIDE_WIDTHS * float(np.median(wide))
    size = 2 * max(1, round(2.0 * aside)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    least = np.full(shape, ground, dtype=np.float32)
    most = least.copy()
    for each in np.unique(level[old & (level > ground)]):
        rows = old & (level >= each)
        broad = draw_lines(shape, ends[rows], wide[rows] + 2.0 * aside)
        most[broad > 0] = each
        least[cv2.erode(broad, disc) > 0] = each
    return least, most
