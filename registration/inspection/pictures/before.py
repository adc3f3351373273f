"""Align the picture taken before a layer, and add the difference to the working picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.errors import PictureError
from registration.inspection.pictures.earlier_view import CameraMove, camera_move
from registration.inspection.pictures.unmeasured import measured_alone, unmeasured_pixels
from registration.inspection.pictures.working import (
    Mask,
    Working,
    WorkingFrame,
    channels_of,
    check_picture,
    dark_floor,
    drawn_lines,
)
from registration.inspection.values import ExpectedLines, Image

MOST_PX: Final = 2.5
"""A camera that moved by more was touched: its picture before isn't used."""
_MOVED: Final = 2 * math.ceil(MOST_PX) + 1
_NEAR: Final = (3.0, 1.4)
"""Widths around fresh lines, and some pixels, that aren't ground: their shade and light reach so
far, and moved a camera that stood still by 3 pixels; less only where too little is left."""
_NEAR_PX: Final = 4.0
_ENOUGH: Final = 5000
"""Pixels of ground that are left."""
_HALO: Final = 2.0
"""Radii of a saturated spot, within which its own light is brighter than the bath's texture."""
_HALO_PX: Final = 3.0


def with_before(
    work: Working,
    frame: WorkingFrame,
    picture: Image,
    before: Image,
    lines: ExpectedLines,
    written: BoolArray,
    stood_still: Callable[[], bool] | None = None,
) -> Working:
    """Return the working picture with the difference to the one before.

    Parameters
    ----------
    work : Working
    frame : WorkingFrame
    picture, before : pictures of one shape
    lines : ExpectedLines
    written : (n,) bool
        Lines that were written since.
    stood_still : function or None
        Tells by marks whether the camera stood still in between: a move of more pixels is one of
        shade on a ground without texture then.

    Raises
    ------
    PictureError
        When the two don't go together.
    """
    check_picture(before, "the picture before")
    if before.shape != picture.shape:
        raise PictureError(
            f"the picture before has the shape {before.shape}, this one {picture.shape}; "
            "take both with the same camera and settings"
        )
    part, old_part = (_part(one, work) for one in (picture, before))
    unmeasured = unmeasured_pixels(old_part)
    old_part = measured_alone(old_part, unmeasured)
    lost = _binned_near(unmeasured, work)
    floor = _floor(part, old_part) if work.is_log else None
    earlier, bad = channels_of(old_part, work.scale, floor)
    free = (1 - lost) * (1 - with_halos(bad | work.bad))
    move = camera_move(work.channels, earlier, _ground(work, frame, lines, written, free))
    moved_px = move.most_px * work.scale
    if moved_px > MOST_PX and stood_still is not None and stood_still():
        move, moved_px = CameraMove(np.eye(2, 3), 0.0), 0.0
    if moved_px > MOST_PX:
        return replace(work, moved_px=moved_px)
    whole = CameraMove(_of_picture(move.matrix, work.scale), 0.0)
    earlier, bad = channels_of(_moved(old_part, whole), work.scale, floor)
    return replace(
        work,
        channels=np.concatenate([work.channels, work.channels - earlier], axis=2),
        bad=work.bad | bad,
        hidden=work.hidden | (lost > 0),
        earlier=earlier,
        moved_px=moved_px,
    )


def with_halos(saturated: BoolArray) -> Mask:
    """Saturated spots with the light around them, (h, w) uint8: glints move with the surface."""
    out = saturated.astype(np.uint8)
    outlines, _ = cv2.findContours(out, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for outline in outlines:
        (x, y), radius = cv2.minEnclosingCircle(outline)
        reach = round(_HALO * (radius + 1.0) + _HALO_PX)
        cv2.circle(out, (round(x), round(y)), reach, 1, cv2.FILLED)
    return np.asarray(out)


def _binned_near(unmeasured: BoolArray, work: Working) -> Mask:
    """Working pixels not measured before, and those within a camera's move, (h, w) uint8."""
    near = cv2.dilate(unmeasured.astype(np.uint8), np.ones((_MOVED,) * 2, np.uint8))
    size = work.shape[1::-1]
    hit = cv2.resize(255 * near, size, interpolation=cv2.INTER_AREA) > 0
    return np.asarray(hit, dtype=np.uint8)


def _part(picture: Image, work: Working) -> Image:
    high, wide = (count * work.scale for count in work.shape)
    x, y = work.origin
    return picture[y : y + high, x : x + wide]


def _moved(part: Image, move: CameraMove) -> Image:
    """A part of a picture moved, in its own type."""
    if np.issubdtype(part.dtype, np.floating):
        return np.asarray(move.applied(part.astype(np.float32)))
    return np.asarray(move.applied(part))


def _of_picture(matrix: FloatArray, scale: int) -> FloatArray:
    """A map of working pixels as one of the picture's."""
    slopes = matrix[:, :2]
    off = scale * matrix[:, 2] + 0.5 * (scale - 1) * (np.ones(2) - slopes.sum(axis=1))
    return np.column_stack([slopes, off])


def _floor(part: Image, old_part: Image) -> float:
    """What is added to the picture before: as much as to this one, by the light of both."""
    light, old_light = (max(float(np.median(one)), 1.0) for one in (part, old_part))
    return dark_floor(part) * old_light / light


def _ground(
    work: Working, frame: WorkingFrame, lines: ExpectedLines, written: BoolArray, free: Mask
) -> Mask:
    """What lies ``free`` (h, w) and far from what was written, (h, w) uint8."""
    ends = np.stack([frame.to_pixels(lines.start), frame.to_pixels(lines.end)], axis=1)[written]
    free = free * (1 - (work.bad | work.hidden).astype(np.uint8))
    for widths in _NEAR:
        wide = widths * lines.width_mm[written] * work.px_per_mm + _NEAR_PX
        ground = free * (1 - drawn_lines(work.shape, ends, wide))
        if cv2.countNonZero(ground) >= _ENOUGH:
            break
    return np.asarray(ground, dtype=np.uint8)
