"""Sort a contour's edges into grid cells, to test if a straight move crosses the contour."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.contours import Contours
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class Cells(NamedTuple):
    """Edges by the square cells that their bounding boxes touch; kernels take it as it is.

    Attributes
    ----------
    start, end : (n, 2) float64, mm
    low : (2,) float64, mm
        Corner of the first cell.
    side : float, mm
    columns, rows : int
    offset, edge : int64
        Edges of cell k are ``edge[offset[k] : offset[k + 1]]``; cells go row by row.
    """

    start: FloatArray
    end: FloatArray
    low: FloatArray
    side: float
    columns: int
    rows: int
    offset: IntArray
    edge: IntArray


def put_in_cells(contours: Contours, side_mm: float) -> Cells:
    """Sort a contour's edges into cells; edges should be short against a cell."""
    start, end = contours.points, contours.points[contours.next]
    low = start.min(axis=0)
    columns, rows = (np.floor((start.max(axis=0) - low) / side_mm) + 1).astype(np.int64)
    first = np.floor((np.minimum(start, end) - low) / side_mm).astype(np.int64)
    last = np.floor((np.maximum(start, end) - low) / side_mm).astype(np.int64)
    offset, edge = _fill_cells(first, last, int(columns), int(rows))
    return Cells(start, end, low, side_mm, int(columns), int(rows), offset, edge)


@jit
def _fill_cells(
    first: IntArray, last: IntArray, columns: int, rows: int
) -> tuple[IntArray, IntArray]:
    offset = np.zeros(columns * rows + 1, np.int64)
    for k in range(len(first)):
        for y in range(first[k, 1], last[k, 1] + 1):
            for x in range(first[k, 0], last[k, 0] + 1):
                offset[y * columns + x + 1] += 1
    for cell in range(columns * rows):
        offset[cell + 1] += offset[cell]
    at = offset[:-1].copy()
    edge = np.empty(offset[-1], np.int64)
    for k in range(len(first)):
        for y in range(first[k, 1], last[k, 1] + 1):
            for x in range(first[k, 0], last[k, 0] + 1):
                cell = y * columns + x
                edge[at[cell]] = k
                at[cell] += 1
    return offset, edge


@jit
def _meet(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> bool:
    """Whether the segments ab and cd cross or touch."""
    c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return c * d <= 0 and a * b <= 0


@jit
def _crosses(ax: float, ay: float, bx: float, by: float, cells: Cells) -> bool:
    """Whether the way from a to b crosses an edge; looked up a cell's length at a time."""
    low, side, start, end = cells.low, cells.side, cells.start, cells.end
    steps = int(math.hypot(bx - ax, by - ay) / side) + 1
    for step in range(steps):
        px, py = ax + (bx - ax) * step / steps, ay + (by - ay) * step / steps
        qx, qy = ax + (bx - ax) * (step + 1) / steps, ay + (by - ay) * (step + 1) / steps
        x0 = max(math.floor((min(px, qx) - low[0]) / side), 0)
        x1 = min(math.floor((max(px, qx) - low[0]) / side), cells.columns - 1)
        y0 = max(math.floor((min(py, qy) - low[1]) / side), 0)
        y1 = min(math.floor((max(py, qy) - low[1]) / side), cells.rows - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                cell = y * cells.columns + x
                for place in range(cells.offset[cell], cells.offset[cell + 1]):
                    j = cells.edge[place]
                    if _meet(ax, ay, bx, by, start[j, 0], start[j, 1], end[j, 0], end[j, 1]):
                        return True
    return False


@jit
def crossing(a: FloatArray, b: FloatArray, cells: Cells) -> NDArray[np.bool_]:
    """Whether each way from a to b (n, 2) crosses an edge."""
    crosses = np.zeros(len(a), np.bool_)
    for k in range(len(a)):
        crosses[k] = _crosses(a[k, 0], a[k, 1], b[k, 0], b[k, 1], cells)
    return crosses
