"""Crop, bin and take the logarithm of a layer picture; draw masks of expected ink and bath."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray
from registration.errors import PictureError
from registration.inspection.pictures.unmeasured import measured_alone, unmeasured_pixels
from registration.inspection.values import ExpectedLines, FloatImage, Frame, Image
from registration.inspection.ways import Seen, Ways

_MARGIN_MM = 2.0
_FINE_PX = 9.0
"""Working pixels in a line's width, about."""
_GAP_PX = 5.0
"""And in a gap that is just tolerated, at least."""
_FEWEST_PX = 3.0
_FLOOR = 0.02
"""Of the highest value."""
_PILED = 3e-5
"""Of the pixels with the highest value: the sensor was saturated."""
_HIT = 25
"""Of 255, from which on a working pixel counts as saturated."""
_SHIFT = 4

Outlines = Sequence[FloatArray]
"""Polygons (k, 2), px of the picture."""
Mask = NDArray[np.uint8]


@dataclass(frozen=True)
class Working:
    """The part of a picture that is worked on.

    Attributes
    ----------
    channels : (h, w, c) float32
        Logarithm of brightness (of a float picture: its values).
    bad : (h, w) bool
        Saturated.
    hidden : (h, w) bool
        Hidden as the caller says, or not measured.
    origin : (x, y), px of the picture
    scale : int
        Pixels of the picture in one.
    px_per_mm : float
        Working pixels.
    is_log : bool
        Whether channels are logarithms of brightness.
    earlier : (h, w, c) float32 or None
        The same of a picture taken before the layer, laid over this one; the second half of
        ``channels`` is then the difference.
    moved_px : float
        By how many pixels of the picture the camera moved in between; NaN without such a picture.
    height : (h, w) float32 or None
        Of a `height_map`: mm above the layer's middle. No channel: it isn't linear between bath
        and ink.
    flanks_lost : bool
        Whether it is a profiler's, which loses points on steep flanks.
    """

    channels: FloatImage
    bad: BoolArray
    hidden: BoolArray
    origin: tuple[int, int]
    scale: int
    px_per_mm: float
    is_log: bool
    earlier: FloatImage | None = None
    moved_px: float = math.nan
    height: FloatImage | None = None
    flanks_lost: bool = False

    @property
    def is_scatter(self) -> bool:
        """Whether it shows what a volume's filaments scatter, in logarithms (`filament_map`)."""
        return not self.is_log and self.height is None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.channels.shape[0], self.channels.shape[1]


@dataclass(frozen=True)
class WorkingFrame:
    """A frame, counted in working pixels."""

    frame: Frame
    origin: tuple[int, int]
    scale: int

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return working pixels (n, 2) of places (n, 3), mm."""
        seen = np.asarray(self.frame.to_pixels(points_mm), dtype=np.float64)
        return np.asarray((seen - self.origin + 0.5) / self.scale - 0.5)


def prepare(
    picture: Image,
    frame: Frame,
    ways: Ways,
    gap_mm: float,
    hidden: Outlines | BoolArray,
) -> tuple[Working, WorkingFrame]:
    """Crop and bin a picture so that a line is some nine pixels wide.

    Raises
    ------
    PictureError
        When the picture isn't one, shows none of the lines, or is too coarse for them.
    """
    check_picture(picture, "the picture")
    seen = Seen.of(ways, frame)
    wide_px = float(np.percentile(ways.width, 10)) * seen.px_per_mm
    if not np.isfinite(wide_px) or wide_px < _FEWEST_PX:
        raise PictureError(
            f"a line of {np.percentile(ways.width, 10):.2f} mm is {wide_px:.1f} px wide "
            f"(at least {_FEWEST_PX:g}); go nearer, or take a camera with more pixels"
        )
    scale = max(1, int(min(wide_px / _FINE_PX, gap_mm * seen.px_per_mm / _GAP_PX)))
    x0, y0, x1, y1 = _box(picture, seen)
    part = picture[y0:y1, x0:x1]
    unmeasured = unmeasured_pixels(part)
    channels, bad = channels_of(measured_alone(part, unmeasured), scale)
    cover = 255 * unmeasured.astype(np.uint8)
    if isinstance(hidden, np.ndarray):
        cover[hidden[y0:y1, x0:x1]] = 255
    else:
        for outline in hidden:
            cv2.fillPoly(cover, [np.rint(np.asarray(outline) - (x0, y0)).astype(np.int32)], 255)
    size = channels.shape[1::-1]
    lost = np.asarray(cv2.resize(cover, size, interpolation=cv2.INTER_AREA) > 0)
    is_float = np.issubdtype(picture.dtype, np.floating)
    if is_float:  # nothing is saturated in it: what isn't finite wasn't measured
        lost, bad = lost | bad, np.zeros_like(bad)
    height = None
    if is_float and channels.shape[2] == 2:
        channels, height = channels[:, :, :1].copy(), channels[:, :, 1].copy()
    work = Working(
        channels, bad, lost, (x0, y0), scale, seen.px_per_mm / scale, not is_float, height=height,
        flanks_lost=height is not None and isinstance(hidden, np.ndarray),
    )  # fmt: skip
    return work, WorkingFrame(frame, (x0, y0), scale)


def check_picture(picture: Image, name: str) -> None:
    """Raise `PictureError` unless it is a grey or colour picture that isn't empty."""
    kind = picture.dtype
    good = kind in (np.uint8, np.uint16) or np.issubdtype(kind, np.floating)
    if picture.ndim not in (2, 3) or not good or min(picture.shape[:2]) < 16:
        raise PictureError(
            f"{name} is an array of {kind}, shape {picture.shape}; expected (rows, columns) or "
            "(rows, columns, channels) of uint8, uint16 or float, 16 x 16 or more"
        )


def _box(picture: Image, seen: Seen) -> tuple[int, int, int, int]:
    """Part of the picture that shows the lines and some bath around."""
    margin = _MARGIN_MM * seen.px_per_mm
    high, wide = picture.shape[:2]
    place = seen.at[np.isfinite(seen.at).all(axis=1)]
    if len(place):
        x0, y0 = np.clip(np.floor(place.min(axis=0) - margin), 0, (wide, high)).astype(int)
        x1, y1 = np.clip(np.ceil(place.max(axis=0) + margin) + 1, 0, (wide, high)).astype(int)
        if min(x1 - x0, y1 - y0) >= 16:
            return int(x0), int(y0), int(x1), int(y1)
    raise PictureError(
        "none of the layer's lines lies in the picture; check the frame (printctl observe check)"
    )


def channels_of(
    part: Image, scale: int, floor: float | None = None
) -> tuple[FloatImage, BoolArray]:
    """Bin a part of a picture: its channels (h, w, c), and where it is saturated or not finite.

    ``floor`` is added before the logarithm; a share of the highest value where it isn't given.
    """
    values = part if part.ndim == 3 else part[:, :, None]
    size = (max(1, part.shape[1] // scale), max(1, part.shape[0] // scale))
    fit = values[: size[1] * scale, : size[0] * scale]
    if np.issubdtype(part.dtype, np.floating):
        if not np.isfinite(fit).any():
            raise PictureError("the picture holds no finite value where the layer lies")
        bad = np.asarray(~np.isfinite(fit).all(axis=2))
        usual = np.nanmedian(np.where(np.isfinite(fit), fit, np.nan), axis=(0, 1))
        filled = np.asarray(np.where(bad[:, :, None], usual, fit), dtype=np.float32)
        return _binned(filled, size), _binned(bad.astype(np.float32), size)[:, :, 0] > 0.25
    saturated = _saturated(np.ascontiguousarray(fit), max(1, int(fit.max())))
    small = _binned(fit.astype(np.float32), size)
    bad = _binned(saturated, size)[:, :, 0] > _HIT
    return np.log(small + np.float32(dark_floor(part) if floor is None else floor)), bad


def dark_floor(part: Image) -> float:
    """Brightness that is added before the logarithm: dark noise mustn't count for contrast."""
    return _FLOOR * max(1, int(part.max()))


def shrunk(values: FloatImage, size: tuple[int, int]) -> FloatImage:
    """Channels (h, w, c) averaged to a size (columns, rows); OpenCV takes four at a time."""
    parts = [
        cv2.resize(np.ascontiguousarray(values[:, :, c]), size, interpolation=cv2.INTER_AREA)
        for c in range(values.shape[2])
    ]
    return np.stack(parts, axis=2)


def _saturated(fit: Image, top: int) -> Mask:
    """Where all channels hold the sensor's highest value: 255, or 0 for none."""
    full = top >= 250 if fit.dtype == np.uint8 else top >= 1000
    low = float(top - top // 200)
    if fit.shape[2] <= 4:
        piled = cv2.inRange(fit, np.full(fit.shape[2], low), np.full(fit.shape[2], float(top)))
    else:
        piled = 255 * (fit >= low).all(axis=2).astype(np.uint8)
    count = cv2.countNonZero(piled)
    enough = full and count > 8 and count > _PILED * piled.size
    return np.asarray(piled if enough else np.zeros_like(piled))


def _binned(values: Image, size: tuple[int, int]) -> FloatImage:
    many = values.ndim == 3 and values.shape[2] > 4
    small = shrunk(values, size) if many else cv2.resize(values, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small if small.ndim == 3 else small[:, :, None])


@dataclass(frozen=True)
class Masks:
    """What is expected where in the working picture, (h, w) uint8 each, 0 or 1.

    Attributes
    ----------
    fresh, old : where such ink should lie
    core : the middle half of fresh lines
    free : far enough from any line to be bath
    """

    fresh: Mask
    old: Mask
    core: Mask
    free: Mask

    @staticmethod
    def of(lines: ExpectedLines, frame: Frame, work: Working, shift_mm: FloatArray) -> Masks:
        """Draw lines, moved by the layer's shift."""
        by = np.append(shift_mm, 0.0)
        ends = np.stack(
            [frame.to_pixels(lines.start + by), frame.to_pixels(lines.end + by)], axis=1
        )
        wide = lines.width_mm * work.px_per_mm
        new, old = lines.fresh, ~lines.fresh
        fresh = drawn_lines(work.shape, ends[new], wide[new])
        earlier = drawn_lines(work.shape, ends[old], wide[old])
        core = drawn_lines(work.shape, ends[new], 0.5 * wide[new])
        near = drawn_lines(work.shape, ends, 1.7 * wide + 4.0)
        blocked = (near > 0) | work.bad | work.hidden
        return Masks(fresh, earlier, core, (~blocked).astype(np.uint8))


def drawn_lines(shape: tuple[int, int], ends: FloatArray, wide: FloatArray) -> Mask:
    """Pieces (n, 2, 2) px drawn with round ends, their widths rounded to whole pixels."""
    out = np.zeros(shape, dtype=np.uint8)
    good = np.isfinite(ends).all(axis=(1, 2)) & (np.abs(ends).max(axis=(1, 2)) < 1e6)
    fixed = np.rint(np.where(good[:, None, None], ends, 0.0) * (1 << _SHIFT)).astype(np.int32)
    thick = np.maximum(1, np.rint(wide)).astype(np.int64)
    for each in np.unique(thick[good]):
        pieces: Sequence[NDArray[np.int32]] = list(fixed[good & (thick == each)])
        cv2.polylines(out, pieces, False, 1, int(each), cv2.LINE_8, _SHIFT)
    return out
