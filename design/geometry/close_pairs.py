"""Find pairs of capsules without a common node closer than a clearance, by grid cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry.segments import point_segment, segment_segment
from kernels import jit
from kernels.arrays import FloatArray, IntArray

_CELLS_PER_PIECE = 8


def close_pairs(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    nodes: IntArray,
    clearance_mm: float,
    clearance_ratio: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Pairs of pieces without a common node and with a gap below the clearance.

    Parameters
    ----------
    start, end : (n, 3) float64, mm
    radius : (n,) float64, mm
    nodes : (n, 2) int64
        At the two ends of each piece.
    clearance_mm, clearance_ratio : float
        See `design.vasculature.collide.collisions`.

    Returns
    -------
    pairs : (k, 2) int64
        Sorted.
    gap : (k,) float64, mm
    place : (k, 3) float64, mm
        Midway between the axes where these are nearest.
    """
    # Each piece is listed in all cells within its reach, so that two that are near share one.
    reach = radius + 0.5 * np.maximum(clearance_mm, clearance_ratio * radius)
    low, high = _bounds(start, end, reach)
    cell = _cell_size(start, end, reach, low, high)
    shape = np.maximum(1, np.ceil((high - low) / cell)).astype(np.int64)
    first, item = _list_pieces(start, end, reach, low, cell, shape)
    size = 1024
    while True:
        pairs = np.empty((size, 2), np.int64)
        values = np.empty((size, 4))
        count = _pairs_in_cells(
            first, item, start, end, radius, nodes, clearance_mm, clearance_ratio, pairs, values
        )
        if count <= size:
            break
        size = count
    order = np.lexsort((pairs[:count, 1], pairs[:count, 0]))
    pairs, values = pairs[order], values[order]
    fresh = np.ones(count, dtype=bool)
    fresh[1:] = (pairs[1:] != pairs[:-1]).any(axis=1)
    return pairs[fresh], values[fresh, 0], values[fresh, 1:]


def _bounds(start: FloatArray, end: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    low: FloatArray = (np.minimum(start, end) - reach[:, None]).min(axis=0)
    high: FloatArray = (np.maximum(start, end) + reach[:, None]).max(axis=0)
    return low, high


def _cell_size(
    start: FloatArray, end: FloatArray, reach: FloatArray, low: FloatArray, high: FloatArray
) -> float:
    """Cells as large as a typical piece, and not many more than pieces."""
    typical = float(np.median(np.linalg.norm(end - start, axis=1) + 2.0 * reach))
    fewest = float(np.cbrt(np.prod(high - low) / (_CELLS_PER_PIECE * len(start) + 64)))
    return max(typical, fewest, 1e-9)


@jit
def _list_pieces(
    start: Any, end: Any, reach: Any, low: Any, cell: float, shape: Any
) -> tuple[Any, Any]:
    """Pieces of each cell: cell c holds ``item[first[c]:first[c + 1]]``."""
    total = shape[0] * shape[1] * shape[2]
    first = np.zeros(total + 1, np.int64)
    item = np.zeros(0, np.int32)
    at = first
    for fill in range(2):
        if fill == 1:
            first[1:] = np.cumsum(first[1:])
            item = np.empty(first[-1], np.int32)
            at = first.copy()
        for i in range(len(start)):
            a, b, r = start[i], end[i], reach[i]
            lo = np.empty(3, np.int64)
            hi = np.empty(3, np.int64)
            for x in range(3):
                lo[x] = max(0, int((min(a[x], b[x]) - r - low[x]) / cell))
                hi[x] = min(shape[x] - 1, int((max(a[x], b[x]) + r - low[x]) / cell))
            far = r + 0.8660254037844387 * cell
            for p in range(lo[0], hi[0] + 1):
                for q in range(lo[1], hi[1] + 1):
                    for s in range(lo[2], hi[2] + 1):
                        d, _ = point_segment(
                            low[0] + (p + 0.5) * cell,
                            low[1] + (q + 0.5) * cell,
                            low[2] + (s + 0.5) * cell,
                            a[0], a[1], a[2], b[0], b[1], b[2],
                        )  # fmt: skip
                        if d > far:
                            continue
                        here = (p * shape[1] + q) * shape[2] + s
                        if fill == 0:
                            first[here + 1] += 1
                        else:
                            item[at[here]] = i
                            at[here] += 1
    return first, item


@jit
def _pairs_in_cells(
    first: Any,
    item: Any,
    start: Any,
    end: Any,
    radius: Any,
    nodes: Any,
    clearance: float,
    ratio: float,
    pairs: Any,
    values: Any,
) -> int:
    """Write close pairs (some more than once); return how many there are, room or not."""
    count = 0
    for c in range(len(first) - 1):
        for x in range(first[c], first[c + 1]):
            i = item[x]
            a, b = start[i], end[i]
            for y in range(x + 1, first[c + 1]):
                j = item[y]
                if (
                    nodes[i, 0] == nodes[j, 0]
                    or nodes[i, 0] == nodes[j, 1]
                    or nodes[i, 1] == nodes[j, 0]
                    or nodes[i, 1] == nodes[j, 1]
                ):
                    continue
                p, q = start[j], end[j]
                d, s, t = segment_segment(
                    a[0], a[1], a[2], b[0], b[1], b[2], p[0], p[1], p[2], q[0], q[1], q[2]
                )
                gap = d - radius[i] - radius[j]
                if gap >= max(clearance, ratio * min(radius[i], radius[j])):
                    continue
                if count < len(pairs):
                    pairs[count, 0], pairs[count, 1] = min(i, j), max(i, j)
                    values[count, 0] = gap
                    for k in range(3):
                        one = a[k] + s * (b[k] - a[k])
                        two = p[k] + t * (q[k] - p[k])
                        values[count, k + 1] = 0.5 * (one + two)
                count += 1
    return count
