"""Crop, bin and log-transform a picture; register the picture before to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.path_samples import PathSamples, ProjectedSamples
from printctl.inspection.pictures.unmeasured import fill_unmeasured, unmeasured_pixels
from printctl.inspection.values import ExpectedLines, FloatImage, Frame, Image
from registration.errors import PictureError

_MARGIN_MM: Final = 2.0
"""Margin of a view around the lines."""
_LINE_WIDTH_PX: Final = 7.0
"""Target width of a line in the view."""
_MIN_GAP_PX: Final = 4.0
"""Least length of a just tolerated gap in the view."""
_MIN_LINE_WIDTH_PX: Final = 3.0
"""Least width of a line in the picture."""
_DARK_FLOOR_SHARE: Final = 0.02
"""Offset before the logarithm, relative to the highest value, that suppresses dark noise."""
_MIN_SATURATED_SHARE: Final = 3e-5
"""Share of pixels at the highest value above which the sensor was saturated."""
MAX_CAMERA_MOVE_PX: Final = 8.0
"""Largest move of a camera; beyond it was touched, and its picture before isn't used."""
_GROUND_CLEARANCE_WIDTHS: Final = (3.0, 1.4)
"""Clearances of ground from fresh lines, in widths, the second where too little is left: lines'
shade moved a camera that stood still by 3 pixels."""
_MIN_GROUND_PX: Final = 5000
"""Least number of ground pixels."""
_MAX_SCATTER_RATIO: Final = 3.0
"""Largest ratio of the ground's scatter in two pictures that are compared: 0.9 to 1.7 in painted
ones, over 4 where one is noise, black or of another scale."""
_MIN_SCATTER: Final = 1e-3
"""Difference in scatter, natural logarithms, that is too faint to compare."""
_ECC_BLUR_PX: Final = 5
"""Gaussian filter size while two pictures are registered."""
LOWEST_THICKNESSES: Final = -0.5
HIGHEST_THICKNESSES: Final = 1.5
"""Limits of heights over the layer's middle; what is outside is clipped to them."""
LAYER_TOP_THICKNESSES: Final = 0.5
"""Height of the layer's top over its middle."""
SUBPIXEL_BITS: Final = 4
"""Fractional bits of the coordinates that OpenCV draws."""

Outlines = Sequence[FloatArray]
"""Polygons (k, 2), px of the picture."""
Mask = NDArray[np.uint8]


@dataclass(frozen=True)
class View:
    """Cropped and binned part of a picture.

    Attributes
    ----------
    now : (h, w, c) float32
        Logarithm of brightness (of a float picture: its values).
    change : (h, w, c) float32 or None
        ``now`` less that of a picture taken before the layer; None without one.
    lost : (h, w) bool
        Saturated, hidden as the caller says, or not measured.
    origin : (x, y), px of the picture
    scale : int
        Pixels of the picture in one.
    px_per_mm : float
        Of the view.
    is_log : bool
        Whether values are logarithms of brightness.
    is_heights : bool
        Whether values are rises over the floor, relative to the layer (`rise`).
    moved_px : float
        Move of the camera since the picture before, px of the picture; NaN without one.
    """

    now: FloatImage
    change: FloatImage | None
    lost: BoolArray
    origin: tuple[int, int]
    scale: int
    px_per_mm: float
    is_log: bool
    is_heights: bool
    moved_px: float = math.nan

    @cached_property
    def channels(self) -> FloatImage:
        """Channels of each pixel: now (h, w, c); or before and change, (h, w, 2 c)."""
        if self.change is None:
            return self.now
        return np.concatenate([self.now - self.change, self.change], axis=2)

    @property
    def inkless(self) -> int:
        """Number of first channels without fresh ink, those of a picture before."""
        return 0 if self.change is None else self.now.shape[2]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.now.shape[0], self.now.shape[1]


@dataclass(frozen=True)
class ViewFrame:
    """Frame in pixels of the view."""

    frame: Frame
    origin: tuple[int, int]
    scale: int

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return the view's pixels (n, 2) of places (n, 3), mm."""
        seen = np.asarray(self.frame.to_pixels(points_mm), dtype=np.float64)
        return np.asarray((seen - self.origin + 0.5) / self.scale - 0.5)


def crop_view(
    picture: Image,
    frame: Frame,
    samples: PathSamples,
    gap_mm: float,
    hidden: Outlines | BoolArray,
    unknown: BoolArray | None = None,
) -> tuple[View, ViewFrame]:
    """Crop and bin a picture so that a line is some nine pixels wide.

    Of two channels of a float picture the first is taken. With ``unknown`` (h, w) pixels,
    whose height is unknown, the picture is one of `rise`.

    Raises
    ------
    PictureError
        When the picture isn't one, shows none of the lines, or is too coarse for them.
    """
    projected = ProjectedSamples.of(samples, frame)
    wide_px = float(np.percentile(samples.width, 10)) * projected.px_per_mm
    if not np.isfinite(wide_px) or wide_px < _MIN_LINE_WIDTH_PX:
        raise PictureError(
            f"a line of {np.percentile(samples.width, 10):.2f} mm is {wide_px:.1f} px wide "
            f"(at least {_MIN_LINE_WIDTH_PX:g}); go nearer, or take a camera with more pixels"
        )
    scale = max(1, int(min(wide_px / _LINE_WIDTH_PX, gap_mm * projected.px_per_mm / _MIN_GAP_PX)))
    x0, y0, x1, y1 = _box(picture, projected)
    part = picture[y0:y1, x0:x1]
    unmeasured = unmeasured_pixels(part)
    if np.issubdtype(part.dtype, np.floating) and part.ndim == 3:
        part = part[:, :, :1]
    now, bad = _binned(fill_unmeasured(part, unmeasured), scale)
    cover = 255 * unmeasured.astype(np.uint8)
    if unknown is not None:
        cover[unknown[y0:y1, x0:x1]] = 255
    if isinstance(hidden, np.ndarray):
        cover[hidden[y0:y1, x0:x1]] = 255
    else:
        for outline in hidden:
            cv2.fillPoly(cover, [np.rint(np.asarray(outline) - (x0, y0)).astype(np.int32)], 255)
    lost = _shrunk(cover.astype(np.float32), now.shape[1::-1]) > 0
    is_float = np.issubdtype(picture.dtype, np.floating)
    view = View(
        now, None, lost | bad, (x0, y0), scale, projected.px_per_mm / scale, not is_float,
        unknown is not None,
    )  # fmt: skip
    return view, ViewFrame(frame, (x0, y0), scale)


def add_change(
    view: View,
    frame: ViewFrame,
    picture: Image,
    before: Image,
    lines: ExpectedLines,
    written: BoolArray,
    stood_still: Callable[[], bool] | None = None,
) -> View:
    """Add the change since a picture before to a view.

    Parameters
    ----------
    view : View
    frame : ViewFrame
    picture, before : pictures of one shape
    lines : ExpectedLines
    written : (n,) bool
        Lines that were written since.
    stood_still : function or None
        Returns whether marks show that the camera stood still in between: a larger fitted move is
        then one of shade on a ground without texture.

    Raises
    ------
    PictureError
        When the two don't go together.
    """
    x, y = view.origin
    high, wide = (count * view.scale for count in view.shape)
    part, old = (one[y : y + high, x : x + wide] for one in (picture, before))
    unmeasured = unmeasured_pixels(old)
    old = fill_unmeasured(old, unmeasured)
    lost = _shrunk(unmeasured.astype(np.float32), view.shape[::-1]) > 0
    floor = _floor(part, old) if view.is_log else None
    earlier, bad = _binned(old, view.scale, floor)
    ground = _ground(view, frame, lines, written) & ~lost & ~bad
    _check_scatter(view.now, earlier, ground)
    move = _camera_move(view.now, earlier, ground)
    moved_px = math.nan if move is None else _most_px(move, view.shape) * view.scale
    if not moved_px <= MAX_CAMERA_MOVE_PX and stood_still is not None and stood_still():
        move, moved_px = np.eye(2, 3), 0.0
    if move is None or moved_px > MAX_CAMERA_MOVE_PX:
        return replace(view, moved_px=moved_px)
    earlier, bad = _binned(_moved(old, _of_picture(move, view.scale)), view.scale, floor)
    near = cv2.dilate((lost | bad).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return replace(
        view, change=view.now - earlier, lost=view.lost | np.asarray(near), moved_px=moved_px
    )


def draw_lines(shape: tuple[int, int], ends: FloatArray, wide: FloatArray) -> Mask:
    """Draw pieces (n, 2, 2) px with round ends, widths rounded to whole pixels, as a mask."""
    out = np.zeros(shape, dtype=np.uint8)
    good = np.isfinite(ends).all(axis=(1, 2)) & (np.abs(ends).max(axis=(1, 2)) < 1e6)
    fixed = np.rint(np.where(good[:, None, None], ends, 0.0) * (1 << SUBPIXEL_BITS)).astype(
        np.int32
    )
    thick = np.maximum(1, np.rint(wide)).astype(np.int64)
    for each in np.unique(thick[good]):
        pieces: Sequence[NDArray[np.int32]] = list(fixed[good & (thick == each)])
        cv2.polylines(out, pieces, False, 1, int(each), cv2.LINE_8, SUBPIXEL_BITS)
    return out


def _box(picture: Image, projected: ProjectedSamples) -> tuple[int, int, int, int]:
    """Return the box (x0, y0, x1, y1) around the lines and some bath."""
    margin = _MARGIN_MM * projected.px_per_mm
    high, wide = picture.shape[:2]
    place = projected.at[np.isfinite(projected.at).all(axis=1)]
    if len(place):
        x0, y0 = np.clip(np.floor(place.min(axis=0) - margin), 0, (wide, high)).astype(int)
        x1, y1 = np.clip(np.ceil(place.max(axis=0) + margin) + 1, 0, (wide, high)).astype(int)
        if min(x1 - x0, y1 - y0) >= 16:
            return int(x0), int(y0), int(x1), int(y1)
    raise PictureError(
        "none of the layer's lines lies in the picture; check the frame (printctl observe check)"
    )


def _binned(part: Image, scale: int, floor: float | None = None) -> tuple[FloatImage, BoolArray]:
    """Bin a part of a picture: its channels (h, w, c), and where it is saturated or not finite."""
    values = part if part.ndim == 3 else part[:, :, None]
    size = (max(1, part.shape[1] // scale), max(1, part.shape[0] // scale))
    fit = np.ascontiguousarray(values[: size[1] * scale, : size[0] * scale])
    if np.issubdtype(part.dtype, np.floating):
        finite = np.isfinite(fit).all(axis=2)
        if not finite.any():
            raise PictureError("the picture holds no finite value where the layer lies")
        usual = np.median(fit[finite], axis=0)
        filled = np.where(finite[:, :, None], fit, usual).astype(np.float32)
        return _shrunk(filled, size), _shrunk((~finite).astype(np.float32), size) > 0.25
    top = max(1, int(fit.max()))
    full = top >= (250 if fit.dtype == np.uint8 else 1000)
    piled = (fit >= top - top // 200).all(axis=2) & full
    enough = piled.sum() > max(8.0, _MIN_SATURATED_SHARE * piled.size)
    bad = _shrunk((piled & enough).astype(np.float32), size) > 0.1
    small = _shrunk(fit.astype(np.float32), size)
    return np.log(small + np.float32(_dark_floor(part) if floor is None else floor)), bad


def _shrunk(values: FloatImage, size: tuple[int, int]) -> FloatImage:
    """Average values (h, w) or (h, w, c) to a size (columns, rows), channel by channel."""
    if values.ndim == 2:
        return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))
    parts = [_shrunk(np.ascontiguousarray(values[:, :, c]), size) for c in range(values.shape[2])]
    return np.stack(parts, axis=2)


def _dark_floor(part: Image) -> float:
    return _DARK_FLOOR_SHARE * max(1, int(part.max()))


def _floor(part: Image, old: Image) -> float:
    """Return the log offset of the picture before, scaled to its light."""
    light, old_light = (max(float(np.median(one)), 1.0) for one in (part, old))
    return _dark_floor(part) * old_light / light


def _ground(view: View, frame: ViewFrame, lines: ExpectedLines, written: BoolArray) -> BoolArray:
    """Return the ground away from what was written, (h, w) bool."""
    ends = np.stack([frame.to_pixels(lines.start), frame.to_pixels(lines.end)], axis=1)[written]
    ground = ~view.lost
    for widths in _GROUND_CLEARANCE_WIDTHS:
        wide = widths * lines.width_mm[written] * view.px_per_mm + 4.0
        ground = ~view.lost & (draw_lines(view.shape, ends, wide) == 0)
        if ground.sum() >= _MIN_GROUND_PX:
            break
    return ground


def _check_scatter(now: FloatImage, earlier: FloatImage, ground: BoolArray) -> None:
    """Raise `PictureError` if one picture's ground is flat, or much noisier than the other's."""
    if ground.sum() < _MIN_GROUND_PX / 10:
        return
    parts = [np.percentile(_texture(one, ground)[ground], [25, 75]) for one in (now, earlier)]
    this, old = (float(high - low) for low, high in parts)
    if max(this, old) > _MAX_SCATTER_RATIO * min(this, old) + _MIN_SCATTER:
        raise PictureError(
            f"around the lines the picture before scatters by {old:.2g}, this one by {this:.2g} "
            f"(at most {_MAX_SCATTER_RATIO:g} times as much): one of them is black, noise or taken "
            "with other settings; take both with the same light and settings, or leave `before` out"
        )


def _camera_move(now: FloatImage, earlier: FloatImage, ground: BoolArray) -> FloatArray | None:
    """Return the Euclidean map (2, 3) to an earlier picture's pixels, by the ground's texture.

    By the enhanced correlation coefficient (Evangelidis and Psarakis 2008, IEEE PAMI 30, 1858). On
    a ground without texture the map is the identity.
    """
    still = np.eye(2, 3)
    if ground.sum() < _MIN_GROUND_PX / 10:
        return None
    both = [_texture(one, ground) for one in (now, earlier)]
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-5)
    mask = ground.astype(np.uint8)
    try:
        found, move = cv2.findTransformECC(
            both[0],
            both[1],
            still.astype(np.float32),
            cv2.MOTION_EUCLIDEAN,
            stop,
            mask,
            _ECC_BLUR_PX,
        )
    except cv2.error:  # no texture
        return still
    at_rest = float(np.corrcoef(both[0][ground], both[1][ground])[0, 1])
    better = _gain(at_rest, float(found), int(ground.sum()))
    return np.asarray(move, dtype=np.float64) if better else still


def _gain(at_rest: float, found: float, count: int) -> bool:
    """Return whether a move explains clearly more than none, given correlated pixels."""
    if not np.isfinite(found) or found < 0.1:
        return False
    left = (1.0 - at_rest**2) / max(1.0 - found**2, 1e-9)
    return bool(math.log(max(left, 1e-9)) * count / 100.0 > 12.0)


def _texture(values: FloatImage, ground: BoolArray) -> FloatImage:
    """Return the channels' mean less its slow part, (h, w)."""
    grey = values.mean(axis=2)
    weight = ground.astype(np.float32)
    light = cv2.GaussianBlur(grey * weight, (0, 0), 12.0)
    light /= np.maximum(cv2.GaussianBlur(weight, (0, 0), 12.0), np.float32(1e-3))
    return np.asarray((grey - light) * weight, dtype=np.float32)


def _most_px(move: FloatArray, shape: tuple[int, int]) -> float:
    """Return the largest move within a view."""
    high, wide = shape
    corners = np.array([[0, 0], [wide, 0], [0, high], [wide, high]], dtype=np.float64)
    off = corners @ move[:, :2].T + move[:, 2] - corners
    return float(np.hypot(off[:, 0], off[:, 1]).max())


def _moved(part: Image, move: FloatArray) -> Image:
    """Move a part of a picture, keeping its type."""
    kept = part.astype(np.float32) if np.issubdtype(part.dtype, np.floating) else part
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = part.shape[1::-1]
    out = cv2.warpAffine(kept, move, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out).reshape(part.shape)


def _of_picture(matrix: FloatArray, scale: int) -> FloatArray:
    """Convert a map of the view's pixels to one of the picture's."""
    slopes = matrix[:, :2]
    off = scale * matrix[:, 2] + 0.5 * (scale - 1) * (np.ones(2) - slopes.sum(axis=1))
    return np.column_stack([slopes, off])
