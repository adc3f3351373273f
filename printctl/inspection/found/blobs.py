"""Find ink where none is expected: blobs, dragged ink, and objects."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, Literal

import cv2
import numpy as np
from scipy.special import ndtr, ndtri

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.found.plane_map import PlaneMap
from printctl.inspection.pictures.picture import Mask
from printctl.inspection.values import Blob, FloatImage

_MIN_LEVEL: Final = 0.5
"""Least level of a blob, where ink is 1."""
_MIN_AREA_SQUARE_WIDTHS: Final = 0.3
"""Least area of a blob, in squared line widths."""
_OBJECT_RADIUS_WIDTHS: Final = 3.0
"""Distance from edge to inside, in widths, above which a find is an object, not ink."""
_MIN_DRAG_ASPECT: Final = 3.0
"""Least length over width of dragged ink."""
_MAX_DISTANCE_MM: Final = 1.2
"""Largest distance from a line; what lies farther isn't this layer's."""
_MAX_BLOBS: Final = 200
"""Largest number of blobs returned."""
_MIN_BATH_PX: Final = 100
"""Least number of bath pixels for learning its level."""
_MAX_LEVEL: Final = 0.85
"""Detection level above which blobs can't be distinguished from a scattering bath."""
_MAX_UNSEEN_SHARE: Final = 0.1
"""Share of unseen surroundings above which a find is a fringe of glare."""
_CREST_PERCENTILE: Final = 95
"""Percentile of a blob's heights reported as its height, below spikes."""
_CREST_INSET_WIDTHS: Final = 0.2
"""Inset from a line's edge, in widths, for heights over the line: its flank is left out."""
_MIN_SCATTER_THICKNESSES: Final = 0.05
"""Least scatter of heights, in thicknesses."""
_RING_WIDTHS: Final = (0.3, 0.9)
"""Distances from a find, in widths, between which the bath around is measured."""
_MAX_RING_LEVEL: Final = 0.25
"""Largest level of a find's surroundings, relative to its own."""


def find_blobs(
    image: FloatImage,
    free: Mask,
    unseen: BoolArray,
    lines: Mask,
    width_px: float,
    place: PlaneMap,
    rate: float,
    unit_mm: float = math.nan,
) -> tuple[Blob, ...]:
    """Return the blobs of a layer.

    Parameters
    ----------
    image : (h, w) float32
        Bath 0, ink 1.
    free : (h, w) uint8
        Where there should be bath alone.
    unseen : (h, w) bool
    lines : (h, w) uint8
        Where any line is expected.
    width_px : float
        Of a line.
    place : PlaneMap
        Pixels to the printer's plane.
    rate : float
        False blobs per sound layer.
    unit_mm : float, mm
        Height that 1 of the image is; NaN where it isn't one of heights, and shade may look like
        ink.
    """
    away = cv2.distanceTransform((lines == 0).astype(np.uint8), cv2.DIST_L2, 3)
    area = np.asarray((free > 0) & ~unseen & (away < _MAX_DISTANCE_MM / place.px_mm))
    smooth = cv2.GaussianBlur(image, (0, 0), max(0.8, 0.25 * width_px))
    is_heights = not math.isnan(unit_mm)
    if area.sum() < _MIN_BATH_PX:
        return ()
    middle, spread, level = _detection_level(smooth[area], width_px, rate, is_heights)
    if level > _MAX_LEVEL:
        return ()
    grown = cv2.dilate(lines, np.ones((3, 3), np.uint8), iterations=2 + round(0.5 * width_px))
    # Distances count to the middle of the first pixel outside.
    inner = cv2.distanceTransform(lines, cv2.DIST_L2, 3) - 0.5 > _CREST_INSET_WIDTHS * width_px
    blobs = list[Blob]()
    for box, own, size, middle_px in _components((smooth > level) & area, width_px):
        height = float(smooth[box][own].mean())
        if not is_heights and not _has_edge(box, own, smooth, area, unseen, width_px, height):
            continue
        kind, outline = _classify(own.astype(np.uint8), width_px)
        at = place.to_printer(middle_px[None])[0]
        blobs.append(
            Blob(
                kind, (float(at[0]), float(at[1])),
                place.to_printer(outline + (box[1].start, box[0].start)),
                size * place.px_mm**2, bool((grown[box][own] > 0).any()),
                float(ndtr((middle - height) / spread)),
                _crest(image[box], own, inner[box]) * unit_mm,
            )
        )  # fmt: skip
    return tuple(blobs)


def _components(
    found: BoolArray, width_px: float
) -> Iterator[tuple[tuple[slice, slice], BoolArray, float, FloatArray]]:
    """Yield connected components, largest first: box, pixels in it, size, middle.

    The box reaches as far around them as the bath is looked at.
    """
    count, labels, stats, middles = cv2.connectedComponentsWithStats(
        found.astype(np.uint8), connectivity=8
    )
    size, far = stats[:, cv2.CC_STAT_AREA], max(1, round(_RING_WIDTHS[1] * width_px))
    large = [k for k in range(1, count) if size[k] >= _MIN_AREA_SQUARE_WIDTHS * width_px**2]
    for k in sorted(large, key=lambda k: -size[k])[:_MAX_BLOBS]:
        x, y, wide, high = (int(v) for v in stats[k, :4])
        box = np.s_[max(0, y - far) : y + high + far, max(0, x - far) : x + wide + far]
        yield box, np.asarray(labels[box] == k), float(size[k]), middles[k]


def _detection_level(
    values: FloatImage, width_px: float, rate: float, is_heights: bool
) -> tuple[float, float, float]:
    """Return middle and spread of the bath's values, and the detection level above them."""
    middle, spread = _usual_height(values) if is_heights else _bath_level(values)
    places = max(1.0, len(values) / width_px**2)
    return middle, spread, max(_MIN_LEVEL, middle - float(ndtri(min(0.5, rate / places))) * spread)


def _has_edge(
    box: tuple[slice, slice],
    own: BoolArray,
    smooth: FloatImage,
    area: BoolArray,
    unseen: BoolArray,
    width_px: float,
    height: float,
) -> bool:
    """Return whether the bath around a find is seen and much lower: fading shade has no edge."""
    flags = own.astype(np.uint8)
    inner, outer = (
        cv2.dilate(flags, np.ones((2 * k + 1, 2 * k + 1), np.uint8)) > 0
        for k in (max(1, round(part * width_px)) for part in _RING_WIDTHS)
    )
    if float(unseen[box][outer & ~own].mean()) > _MAX_UNSEEN_SHARE:
        return False
    ring = outer & ~inner & area[box]
    return not ring.any() or float(smooth[box][ring].mean()) < _MAX_RING_LEVEL * height


def _bath_level(values: FloatImage) -> tuple[float, float]:
    """Return the bath's middle and a tail-aware deviation, from the side without ink."""
    some = values[:: max(1, len(values) // 200_000)]
    low, middle = np.quantile(some, [0.1587, 0.5])
    spread = float(middle - low)
    for tail in (0.01, 0.001):
        if tail * len(some) >= 20:
            below = float(np.quantile(some, tail))
            spread = max(spread, float(middle - below) / float(-ndtri(tail)))
    return float(middle), max(spread, 1e-6)


def _usual_height(values: FloatImage) -> tuple[float, float]:
    """Return middle and scatter of heights over the expected ones."""
    low, middle, high = np.quantile(values, [0.1587, 0.5, 0.8413])
    return float(middle), max(float(high - middle), float(middle - low), _MIN_SCATTER_THICKNESSES)


def _crest(image: FloatImage, own: BoolArray, inner: BoolArray) -> float:
    """Return a find's height over lines' middles where it lies on some, else over the bath."""
    part = own & inner if (own & inner).any() else own
    return float(np.percentile(image[part], _CREST_PERCENTILE))


def _classify(own: Mask, width_px: float) -> tuple[Literal["blob", "drag", "object"], FloatArray]:
    outlines, _ = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    outline = max(outlines, key=cv2.contourArea)[:, 0].astype(np.float64)
    padded = cv2.copyMakeBorder(own, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    if cv2.distanceTransform(padded, cv2.DIST_L2, 3).max() > _OBJECT_RADIUS_WIDTHS * width_px:
        return "object", outline
    _, sides, _ = cv2.minAreaRect((outline - outline.min(axis=0)).astype(np.float32))
    long, short = max(sides) + 1, min(sides) + 1
    return ("drag" if long > _MIN_DRAG_ASPECT * short else "blob"), outline
