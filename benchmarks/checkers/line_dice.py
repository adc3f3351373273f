"""Paint lines of layers as seen from above and compare two prints: Dice, gaps left.

Shares no code with the product: capsules on a raster, by distances to segments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
PIXEL_MM = 0.02


def painted(
    start: FloatArray, end: FloatArray, width: FloatArray, box: tuple[float, float, float, float]
) -> BoolArray:
    """Return which pixels of a box (x0, y0, x1, y1), mm, lines (n, 2) to (n, 2) cover."""
    x0, y0, x1, y1 = box
    columns, rows = round((x1 - x0) / PIXEL_MM), round((y1 - y0) / PIXEL_MM)
    found = np.zeros((rows, columns), dtype=bool)
    for a, b, wide in zip(start, end, width, strict=True):
        if wide <= 0:
            continue
        half = wide / 2
        low, high = np.minimum(a, b) - half, np.maximum(a, b) + half
        i0, i1 = (
            max(int((low[0] - x0) / PIXEL_MM), 0),
            min(int((high[0] - x0) / PIXEL_MM) + 2, columns),
        )
        j0, j1 = (
            max(int((low[1] - y0) / PIXEL_MM), 0),
            min(int((high[1] - y0) / PIXEL_MM) + 2, rows),
        )
        if i0 >= i1 or j0 >= j1:
            continue
        x = x0 + (np.arange(i0, i1) + 0.5) * PIXEL_MM
        y = y0 + (np.arange(j0, j1) + 0.5) * PIXEL_MM
        px, py = np.meshgrid(x, y)
        step = b - a
        square = float(step @ step)
        share = ((px - a[0]) * step[0] + (py - a[1]) * step[1]) / square if square > 0 else 0 * px
        share = np.clip(share, 0.0, 1.0)
        away = np.hypot(px - a[0] - share * step[0], py - a[1] - share * step[1])
        found[j0:j1, i0:i1] |= away <= half
    return found


def dice(one: BoolArray, other: BoolArray) -> float:
    """Twice what both cover over the sum of what each covers."""
    both = np.count_nonzero(one & other)
    return 2.0 * both / (np.count_nonzero(one) + np.count_nonzero(other))
