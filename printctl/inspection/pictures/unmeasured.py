"""Find constant A-scans and picture blocks, which hold no measurement.

A sensor's values scatter. A-scans of one value over their whole depth (a B-scan that was dropped)
and blocks or rows of one value in a picture (a lost packet, a dead row) hold no measurement. In a
picture with blocks of one value nearly everywhere (smoothed by the camera, clipped or synthetic)
they are ignored.
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray
from printctl.inspection.values import Image

_MIN_BLOCK_PX: Final = 8
"""Least side of a block of one value: the smallest part that a JPEG loses."""
_MIN_RUN_PX: Final = 48
"""Least length of a row or column of one value."""
_TILES_PER_SIDE: Final = 8
"""Tiles per side of a picture, for testing whether such blocks are common."""
_COMMON_TILE_SHARE: Final = 0.02
"""Share of a tile in such blocks from which on they are common."""
_SENSOR_MAXIMA: Final = (255, 1023, 4095, 16383, 65535)
"""Largest values of sensors of 8 to 16 bits."""
_SATURATED_SHARE: Final = 0.98
"""Share of a sensor's largest value from which on a block is clipped, and was measured."""


def unmeasured_scans(volume: NDArray[Any]) -> BoolArray:
    """Return the A-scans of a volume (depth, rows, columns) without measurement, (rows, columns).

    One value alone, or those of a B-scan that is the one before to the last bit: speckle and noise
    never repeat. A volume of which most B-scans do is painted without noise.
    """
    return _of_one_value(volume) | _repeated(volume)


def _repeated(volume: NDArray[Any]) -> BoolArray:
    """Return the A-scans of repeated B-scans, along rows or columns, (rows, columns)."""
    out = np.zeros(volume.shape[1:], dtype=np.bool_)
    for axis in (1, 2):
        scans = np.moveaxis(volume, axis, 0)
        same = np.array([_same(*pair) for pair in zip(scans[1:], scans[:-1], strict=True)])
        if not same.all():
            np.moveaxis(out, axis - 1, 0)[1:][same] = True
    return out


def _same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    few = (slice(None, None, 7), slice(None, None, 7))  # hardly any are, and that is soon seen
    return np.array_equal(one[few], other[few]) and np.array_equal(one, other)


def _of_one_value(volume: NDArray[Any]) -> BoolArray:
    """Return the A-scans of one value alone, (rows, columns)."""
    same = np.ones(volume.shape[1:], dtype=np.bool_)
    first = np.asarray(volume[0])
    for plane in volume[1:]:
        same &= np.asarray(plane) == first
        if not same.any():
            break
    return same & (len(volume) > 1)


def unmeasured_pixels(part: Image) -> BoolArray:
    """Return blocks and rows of one value in a picture (h, w) or (h, w, c), as (h, w) bool.

    Nothing of a float picture, which is made from measurements, nor of one in which such blocks
    are common.
    """
    shape = part.shape[:2]
    if np.issubdtype(part.dtype, np.floating):
        return np.zeros(shape, dtype=np.bool_)
    channels = [part] if part.ndim == 2 else list(np.moveaxis(part, 2, 0))
    beside = _all([one[:, 1:] == one[:, :-1] for one in channels])
    below = _all([one[1:] == one[:-1] for one in channels])
    long, short = (
        (_in_runs(beside, (1, count - 1), shape), _in_runs(below, (count - 1, 1), shape))
        for count in (_MIN_RUN_PX, _MIN_BLOCK_PX)
    )
    out = long[0] | long[1] | opened(short[0] & short[1], (_MIN_BLOCK_PX, _MIN_BLOCK_PX))
    if not out.any():
        return out
    ceiling = next(one for one in _SENSOR_MAXIMA if one >= part.max())
    out &= ~_all([one >= _SATURATED_SHARE * ceiling for one in channels])
    return np.zeros_like(out) if _is_common(out) else out


def _all(each: list[BoolArray]) -> BoolArray:
    out = each[0]
    for one in each[1:]:
        out = out & one
    return out


def fill_unmeasured(part: Image, unmeasured: BoolArray) -> Image:
    """Fill unmeasured pixels with the picture's median, so that they don't spread."""
    if not unmeasured.any():
        return part
    usual = np.median(part[~unmeasured], axis=0).astype(part.dtype)
    out = part.copy()
    out[unmeasured] = usual
    return out


def _in_runs(same: BoolArray, size: tuple[int, int], shape: tuple[int, int]) -> BoolArray:
    """Return pixels of runs of ``size`` equal neighbours, (h, w)."""
    out = np.zeros(shape, dtype=np.bool_)
    runs = opened(same, size)
    high, wide = runs.shape
    out[:high, :wide] |= runs
    out[shape[0] - high :, shape[1] - wide :] |= runs
    return out


def opened(mask: BoolArray, size: tuple[int, int]) -> BoolArray:
    """Return pixels within rectangles (rows, columns) that are all set."""
    kernel, (high, wide) = np.ones(size, np.uint8), size
    flags = mask.astype(np.uint8)
    whole = cv2.erode(flags, kernel, anchor=(0, 0), borderType=cv2.BORDER_CONSTANT, borderValue=0.0)
    # OpenCV's own opening moves by a pixel where a kernel has an even side.
    spread = cv2.dilate(
        whole, kernel, anchor=(wide - 1, high - 1), borderType=cv2.BORDER_CONSTANT, borderValue=0.0
    )
    return np.asarray(spread > 0)


def _is_common(flat: BoolArray) -> bool:
    """Return whether most tiles that aren't of one value altogether have such blocks.

    Outer rows and columns that hold nothing else are left out: of a picture that broke off early
    few tiles are left, and where it broke off each has some.
    """
    if flat.all():
        return True
    rows, columns = (np.flatnonzero(~flat.all(axis=axis)) for axis in (1, 0))
    flat = flat[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    size = (min(_TILES_PER_SIDE, flat.shape[1]), min(_TILES_PER_SIDE, flat.shape[0]))
    share = cv2.resize(flat.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    some = share[share < 0.999]
    return bool(not len(some) or np.median(some) > _COMMON_TILE_SHARE)
