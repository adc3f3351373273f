"""Find ink where none is expected: blobs, dragged ink, and things too big to be ink."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.found.plane_map import PlaneMap
from registration.inspection.pictures.picture import Mask
from registration.inspection.values import Blob, FloatImage

_LEVEL: Final = 0.5
_LEAST: Final = 0.3
"""Of a squared width: smaller areas aren't told."""
_BIG: Final = 3.0
"""Widths from its edge to its inside: no line leaves so much."""
_DRAWN_OUT: Final = 3.0
_NEAR_MM: Final = 1.2
"""From a line: what lies further off isn't this layer's."""
_MOST: Final = 200
_FEWEST: Final = 100
"""Pixels of bath by which its level is learned."""
_HIGHEST_LEVEL: Final = 0.85
"""Of ink's level: a bath that scatters up to it tells of no blobs."""
_BESIDE_GLARE: Final = 0.1
"""Of a find's surroundings that aren't seen: more, and it is a fringe of that."""
_CREST: Final = 95
"""Percentile of a blob's heights that is told as its height: spikes aren't it."""
_INNER: Final = 0.2
"""Widths from a line's edge: its flank, where a blob's height isn't told over the line."""
_UNEVEN: Final = 0.05
"""Least scatter of heights, thicknesses."""
_OUTSIDE: Final = 0.25
"""Of a find's level, below which its surroundings lie."""


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
    """Return blobs.

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
    area = np.asarray((free > 0) & ~unseen & (away < _NEAR_MM / place.px_mm))
    smooth = cv2.GaussianBlur(image, (0, 0), max(0.8, 0.25 * width_px))
    is_heights = not math.isnan(unit_mm)
    if area.sum() < _FEWEST:
        return ()
    middle, spread, level = _levels(smooth[area], width_px, rate, is_heights)
    if level > _HIGHEST_LEVEL:
        return ()
    grown = cv2.dilate(lines, np.ones((3, 3), np.uint8), iterations=2 + round(0.5 * width_px))
    # Distances count to the middle of the first pixel outside.
    inner = cv2.distanceTransform(lines, cv2.DIST_L2, 3) - 0.5 > _INNER * width_px
    blobs = list[Blob]()
    for find in _finds((smooth > level) & area, _LEAST * width_px**2):
        box, own = find.box(), find.own()
        height = float(smooth[box][own].mean())
        if not is_heights and not _has_edge(find, smooth, area, unseen, width_px, height):
            continue
        kind, outline = _kind(own.astype(np.uint8), width_px)
        at = place.to_printer(find.middle[None])[0]
        blobs.append(
            Blob(
                kind, (float(at[0]), float(at[1])), place.to_printer(outline + find.corner),
                find.size * place.px_mm**2, bool((grown[box][own] > 0).any()),
                float(ndtr((middle - height) / spread)),
                _crest(image[box], own, inner[box]) * unit_mm,
            )
        )  # fmt: skip
    return tuple(blobs)


@dataclass(frozen=True)
class _Find:
    """Pixels that hang together: those of one number."""

    labels: NDArray[np.int32]
    number: int
    stats: NDArray[np.int32]
    middle: FloatArray

    @property
    def corner(self) -> tuple[int, int]:
        """First column and row."""
        return int(self.stats[cv2.CC_STAT_LEFT]), int(self.stats[cv2.CC_STAT_TOP])

    @property
    def size(self) -> float:
        """Number of pixels."""
        return float(self.stats[cv2.CC_STAT_AREA])

    def box(self, margin: int = 0) -> tuple[slice, slice]:
        """Rows and columns around it."""
        (x, y), wide, high = self.corner, *(int(v) for v in self.stats[2:4])
        low_y, low_x = max(0, y - margin), max(0, x - margin)
        return np.s_[low_y : y + high + margin, low_x : x + wide + margin]

    def own(self, margin: int = 0) -> BoolArray:
        """Its pixels in there."""
        return np.asarray(self.labels[self.box(margin)] == self.number)


def _finds(found: BoolArray, least: float) -> list[_Find]:
    """Pixels that hang together, of a size at least, the largest first."""
    count, labels, stats, middles = cv2.connectedComponentsWithStats(
        found.astype(np.uint8), connectivity=8
    )
    finds = [_Find(labels, k, stats[k], middles[k]) for k in range(1, count)]
    large = [find for find in finds if find.size >= least]
    return sorted(large, key=lambda find: -find.size)[:_MOST]


def _levels(
    values: FloatImage, width_px: float, rate: float, is_heights: bool
) -> tuple[float, float, float]:
    """Middle and spread of the bath's values, and the level that hardly any of them exceeds."""
    middle, spread = _usual_height(values) if is_heights else _bath_level(values)
    places = max(1.0, len(values) / width_px**2)
    return middle, spread, max(_LEVEL, middle - float(ndtri(min(0.5, rate / places))) * spread)


def _has_edge(
    find: _Find,
    smooth: FloatImage,
    area: BoolArray,
    unseen: BoolArray,
    width_px: float,
    height: float,
) -> bool:
    """Whether the bath around a find is seen, and much lower: shade that fades has no edge."""
    near, far = (max(1, round(part * width_px)) for part in (0.3, 0.9))
    box, own = find.box(far), find.own(far).astype(np.uint8)
    inner, outer = (
        cv2.dilate(own, np.ones((2 * k + 1, 2 * k + 1), np.uint8)) > 0 for k in (near, far)
    )
    ring = outer & ~inner & area[box]
    beside = outer & (own == 0)
    if float(unseen[box][beside].mean()) > _BESIDE_GLARE:
        return False
    return not ring.any() or float(smooth[box][ring].mean()) < _OUTSIDE * height


def _bath_level(values: FloatImage) -> tuple[float, float]:
    """Middle of the bath, and a deviation that stands for its tail, by the side without ink."""
    some = values[:: max(1, len(values) // 200_000)]
    low, middle = np.quantile(some, [0.1587, 0.5])
    spread = float(middle - low)
    for tail in (0.01, 0.001):
        if tail * len(some) >= 20:
            below = float(np.quantile(some, tail))
            spread = max(spread, float(middle - below) / float(-ndtri(tail)))
    return float(middle), max(spread, 1e-6)


def _usual_height(values: FloatImage) -> tuple[float, float]:
    """Middle of heights over the expected ones, and their scatter: what is low may be missing."""
    low, middle, high = np.quantile(values, [0.1587, 0.5, 0.8413])
    return float(middle), max(float(high - middle), float(middle - low), _UNEVEN)


def _crest(image: FloatImage, own: BoolArray, inner: BoolArray) -> float:
    """Height of a find: over the middles of lines where it lies on some, else over the bath."""
    part = own & inner if (own & inner).any() else own
    return float(np.percentile(image[part], _CREST))


def _kind(own: Mask, width_px: float) -> tuple[Literal["blob", "drag", "object"], FloatArray]:
    outlines, _ = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    outline = max(outlines, key=cv2.contourArea)[:, 0].astype(np.float64)
    padded = cv2.copyMakeBorder(own, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    if cv2.distanceTransform(padded, cv2.DIST_L2, 3).max() > _BIG * width_px:
        return "object", outline
    _, sides, _ = cv2.minAreaRect(outline.astype(np.float32))
    long, short = max(sides) + 1, min(sides) + 1
    return ("drag" if long > _DRAWN_OUT * short else "blob"), outline
