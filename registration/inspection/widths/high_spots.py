"""Find blobs on a layer's lines: what stands over the ink around, in a height map."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray
from registration.inspection.pictures.plane_map import PlaneMap
from registration.inspection.pictures.working import Mask
from registration.inspection.values import Blob, FloatImage

_OVER: Final = 0.5
"""Thicknesses over the ink around: lines that cross or touch stand less high."""
_EDGE: Final = 0.25
"""Thicknesses, at which a blob's edge lies."""
_LEAST: Final = 0.3
"""Of a squared width: smaller areas aren't told."""
_CORE: Final = 0.15
"""Of a squared width, that stand over the ink by the whole of `_OVER`."""
_DRAWN_OUT: Final = 3.0
_HIGH_PERCENT: Final = 90.0
_SURE: Final = 1e-6
"""Chance of one by a map's noise: several cells of half a layer."""


def high_spots(
    over: FloatImage,
    near: Mask,
    hidden: BoolArray,
    thickness_mm: float,
    width_px: float,
    place: PlaneMap,
) -> tuple[Blob, ...]:
    """Return what stands over the ink.

    Parameters
    ----------
    over : (h, w) float32
        Heights over the ink's level, thicknesses.
    near : (h, w) uint8
        On the layer's lines or beside them, where it may lie.
    hidden : (h, w) bool
    thickness_mm : float, mm
    width_px : float
        Of a line.
    place : PlaneMap
        Pixels to the printer's plane.
    """
    smooth = cv2.medianBlur(np.ascontiguousarray(over, dtype=np.float32), 3)
    known = (near > 0) & ~hidden
    low, high = (((smooth > least) & known).astype(np.uint8) for least in (_EDGE, _OVER))
    count, labels, stats, middles = cv2.connectedComponentsWithStats(low, connectivity=8)
    core = np.bincount(labels[high > 0], minlength=count)
    found = list[Blob]()
    for k in range(1, count):
        area = int(stats[k, cv2.CC_STAT_AREA])
        if area < _LEAST * width_px**2 or core[k] < max(4, _CORE * width_px**2):
            continue
        x, y, wide, tall = stats[k, :4]
        own = labels[y : y + tall, x : x + wide] == k
        outlines, _ = cv2.findContours(
            own.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
        )
        outline = max(outlines, key=cv2.contourArea)[:, 0].astype(np.float64)
        _, sides, _ = cv2.minAreaRect(outline.astype(np.float32))
        at = place.to_printer(middles[k][None])[0]
        top = float(np.percentile(smooth[y : y + tall, x : x + wide][own], _HIGH_PERCENT))
        found.append(
            Blob(
                "drag" if max(sides) + 1 > _DRAWN_OUT * (min(sides) + 1) else "blob",
                (float(at[0]), float(at[1])),
                place.to_printer(outline + (x, y)),
                area * place.px_mm**2,
                True,
                _SURE,
                top * thickness_mm,
            )
        )
    return tuple(found)
