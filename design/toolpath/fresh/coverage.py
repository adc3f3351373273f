"""Measure the areas of a layer covered, left empty or overrun by its printed lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.infill import scan
from kernels import jit
from kernels.arrays import FloatArray, IntArray

# Lines count as stadiums: all points within half a width of the centreline.
RASTER_PER_LINE: Final = 10
"""Raster points per line width."""


@dataclass(frozen=True)
class Coverage:
    """Areas of one layer, mm²: material, material not covered, and covered outside it."""

    material: float
    unfilled: float
    outside: float


@jit
def _paint(
    covered: NDArray[np.bool_],
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    corner: FloatArray,
    pitch: float,
) -> None:
    """Set the raster points within ``radius`` of each line; exact along a row."""
    rows, columns = covered.shape
    for k in range(len(start)):
        x0, y0, x1, y1, r = start[k, 0], start[k, 1], end[k, 0], end[k, 1], radius[k]
        dx, dy = x1 - x0, y1 - y0
        length = np.sqrt(dx * dx + dy * dy)
        first = max(0, int(np.ceil((min(y0, y1) - r - corner[1]) / pitch)))
        last = min(rows - 1, int(np.floor((max(y0, y1) + r - corner[1]) / pitch)))
        for row in range(first, last + 1):
            y = corner[1] + row * pitch
            low, high = np.inf, -np.inf
            for cx, cy in ((x0, y0), (x1, y1)):
                if abs(y - cy) <= r:
                    half = np.sqrt(r * r - (y - cy) ** 2)
                    low, high = min(low, cx - half), max(high, cx + half)
            if length > 0:
                # The straight sides: where the row cuts the rectangle's four edges.
                nx, ny = -dy / length * r, dx / length * r
                px = (x0 + nx, x1 + nx, x1 - nx, x0 - nx)
                py = (y0 + ny, y1 + ny, y1 - ny, y0 - ny)
                for m in range(4):
                    n = (m + 1) % 4
                    if (py[m] <= y) != (py[n] <= y):
                        cut = px[m] + (y - py[m]) / (py[n] - py[m]) * (px[n] - px[m])
                        low, high = min(low, cut), max(high, cut)
            left = max(0, int(np.ceil((low - corner[0]) / pitch))) if low <= high else 0
            right = (
                min(columns - 1, int(np.floor((high - corner[0]) / pitch))) if low <= high else -1
            )
            for column in range(left, right + 1):
                covered[row, column] = True


def measure_coverage(
    contours: list[FloatArray],
    start: FloatArray,
    end: FloatArray,
    width_mm: FloatArray,
    pitch_mm: float,
) -> Coverage:
    """Compare what the lines cover with the region inside ``contours`` (even-odd).

    Parameters
    ----------
    contours : list of (k, 2) float64, mm
    start, end : (n, 2) float64, mm
        Of the lines.
    width_mm : (n,) float64, mm
    pitch_mm : float, mm
        Of the raster; areas are right to about half of it times the boundary's length.
    """
    points = np.concatenate([*contours, start, end])
    margin = float(width_mm.max(initial=0.0)) / 2 + pitch_mm
    # Half a pitch off the lowest point keeps rows off the edges that lie along the axes.
    corner = points.min(axis=0) - margin - 0.5 * pitch_mm
    columns, rows = (np.ceil((points.max(axis=0) + margin - corner) / pitch_mm) + 1).astype(int)
    covered = np.zeros((rows, columns), dtype=np.bool_)
    _paint(covered, start, end, 0.5 * width_mm, corner, pitch_mm)
    spans = scan([ring - corner for ring in contours], pitch_mm, 0.0)
    first, after = (np.ceil(x / pitch_mm).astype(np.int64) for x in (spans.low, spans.high))
    material, bare = _count(covered, spans.row, first, after)
    outside = int(np.count_nonzero(covered)) - (material - bare)
    area = pitch_mm**2
    return Coverage(material * area, bare * area, outside * area)


@jit
def _count(
    covered: NDArray[np.bool_], row: IntArray, first: IntArray, after: IntArray
) -> tuple[int, int]:
    """Raster points in disjoint intervals ``first`` to ``after`` of rows; those not covered."""
    material, bare = 0, 0
    for k in range(len(row)):
        material += after[k] - first[k]
        for column in range(first[k], after[k]):
            bare += not covered[row[k], column]
    return material, bare
