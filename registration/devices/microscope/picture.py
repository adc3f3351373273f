"""Read a picture of a print and mask the ink; records of the calibration pattern."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.devices.lens.board import decoded
from registration.devices.lens.lens import Lens
from registration.errors import PictureError


@dataclass(frozen=True)
class Target:
    """What is looked for, in the pattern's own frame, y up.

    Attributes
    ----------
    size_mm : (x, y), mm
        Of the frame.
    width_mm : float, mm
        Of its lines, about.
    margin_mm : float, mm
        Between the frame and all else.
    points : (n, 2) float64, mm
        Along everything that is written.
    """

    size_mm: tuple[float, float]
    width_mm: float
    margin_mm: float
    points: FloatArray

    @property
    def sides(self) -> list[FloatArray]:
        """Left, bottom, right half, top half: begin and end, (2, 2) each, mm."""
        x, y = self.size_mm
        ends = [((0, y), (0, 0)), ((0, 0), (x, 0)), ((x, y / 2), (x, y)), ((x, y), (x / 2, y))]
        return [np.array(side, dtype=np.float64) for side in ends]


@dataclass(frozen=True)
class View:
    """Position of the pattern in the picture.

    Attributes
    ----------
    matrix : (3, 3) float64
        From mm to pixels.
    mirrored : bool
        Whether it is seen from below, or the picture is flipped.
    um_per_px : float
        In the frame's middle.
    off_mm : float, mm
        Root mean square distance of the frame's ink from its straight sides.
    on_ink : float
        Share of the pattern that lies on ink.
    """

    matrix: FloatArray
    mirrored: bool
    um_per_px: float
    off_mm: float
    on_ink: float


COARSE_PX: Final = 900
"""Longest side of the small copy in which the pattern is looked for."""
_GROUND: Final = 0.22
"""Side of the median that takes the ink away, of the small copy's shorter side."""
_LEAST_CONTRAST: Final = 5.0
"""Between ink and ground, in deviations of the ground's noise, in the small copy."""


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes
    ----------
    ink : (h, w) float32
        Higher where there is ink, in the file's units; ground and light are still in it.
    seen : (h, w, 3) uint8
        For people to look at; blue, green, red.
    small : (k, l) bool
        Where there is ink, in a copy smaller by `shrunk`.
    shrunk : float
    """

    ink: Float32Array
    seen: NDArray[np.uint8]
    small: BoolArray
    shrunk: float


def read_picture(path: Path, lens: Lens | None = None) -> Picture:
    """Read a picture (`decoded`), and find what is ink in it.

    Of several channels that is taken in which ink and ground differ most. The distortion of a
    ``lens`` is taken out.

    Raises
    ------
    PictureError
        When it can't be read, or nothing stands out in it.
    """
    pixels = decoded(path)
    return _chosen(pixels if lens is None else lens.straighten(pixels, path), path)


def _chosen(pixels: NDArray[Any], path: Path) -> Picture:
    """The channel with the best contrast, ink made high."""
    shrunk = min(1.0, COARSE_PX / max(pixels.shape[:2]))
    size = [max(1, round(side * shrunk)) for side in pixels.shape[1::-1]]
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    best: tuple[float, int, float, BoolArray] = (0.0, 0, 1.0, np.zeros((1, 1), bool))
    grey = all(np.array_equal(small[:, :, 0], small[:, :, other]) for other in (1, 2))
    for channel in range(1 if grey else 3):
        plain = np.ascontiguousarray(small[:, :, channel])
        flat = plain - _ground(plain)
        sign = 1.0 if float((flat.astype(np.float64) ** 3).sum()) >= 0 else -1.0
        contrast, mask = _split(sign * flat)
        if contrast > best[0]:
            best = (contrast, channel, sign, mask)
    contrast, channel, sign, mask = best
    if contrast < _LEAST_CONTRAST:
        raise PictureError(
            f"{path}: nothing stands out from the ground (contrast {contrast:.1f} of its noise, "
            f"{_LEAST_CONTRAST:g} wanted); light it evenly, focus on the lines, dye the ink"
        )
    ink = sign * np.ascontiguousarray(pixels[:, :, channel]).astype(np.float32)
    return Picture(ink, _eight_bit(pixels), mask, shrunk)


def _ground(plain: Float32Array) -> Float32Array:
    """Light without ink: a wide median, at a quarter of the size for its speed."""
    low, high = float(plain.min()), float(plain.max())
    scaled = ((plain - low) / max(high - low, 1e-9) * 255).astype(np.uint8)
    tiny = cv2.resize(scaled, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    side = max(3, int(_GROUND * min(tiny.shape)) | 1)
    wide = cv2.medianBlur(tiny, side)
    smooth = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), side / 4)
    back = cv2.resize(smooth, plain.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(back / 255 * (high - low) + low)


def _split(flat: Float32Array) -> tuple[float, BoolArray]:
    """Contrast in deviations of the noise, and the ink's mask, by Otsu's threshold."""
    noise = 1.4826 * float(np.median(np.abs(flat - np.median(flat))))
    high = float(np.percentile(flat, 99.5))
    if high <= 0:
        return 0.0, flat > np.inf
    scaled = (np.clip(flat / high, 0, 1) * 255).astype(np.uint8)
    _, mask = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    ink = mask > 0
    if not ink.any() or ink.all():
        return 0.0, ink
    apart = float(flat[ink].mean() - flat[~ink].mean())
    return apart / max(noise, 1e-3 * high), ink


def _eight_bit(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    if pixels.dtype == np.uint8:
        return np.asarray(pixels)
    low, high = np.percentile(pixels, [0.1, 99.9])
    share = (pixels.astype(np.float32) - low) / max(float(high - low), 1e-9)
    return np.asarray(np.clip(share * 255, 0, 255), dtype=np.uint8)
