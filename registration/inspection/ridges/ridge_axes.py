"""Nearest middles of fresh lines, of all of them or without a stretch of one."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.values import ExpectedLines
from registration.inspection.ways import from_stroke_begin

_APART: Final = 0.15
"""Widths between the points that stand for lines, at most."""
_CELL: Final = 0.8
"""Widths, side of the cells that points are sorted by: about as far as lines are looked for."""
_MOST_CELLS: Final = 1000
"""Each way."""


class Axes(NamedTuple):
    """Points along the middles of fresh lines, each of which stands for the piece around it.

    Attributes
    ----------
    at : (m, 2) float64, mm
        Sorted by cell, rows first.
    ahead : (m, 2) float64
        Way of the line, a unit vector.
    piece : (m, 2) float64, mm
        From where to where along it a point stands for the line: as far as half way to the next.
    stroke : (m,) int64
    along : (m,) float64, mm
        From the stroke's begin.
    first : (rows, columns + 1) int64
        Each cell's first point; the next one's is the end of its points.
    low : (2,) float64, mm
        Corner of the first cell.
    side : float, mm
        Of a cell.
    longest : float, mm
        Half of a piece at most.
    """

    at: FloatArray
    ahead: FloatArray
    piece: FloatArray
    stroke: IntArray
    along: FloatArray
    first: IntArray
    low: FloatArray
    side: float
    longest: float


class Stretch(NamedTuple):
    """A stretch of each place's own line that is left out.

    Attributes
    ----------
    stroke : (k,) int64
    along : (k,) float64, mm
        Its middle.
    half_mm : float, mm
        Half of its length; 0 leaves nothing out.
    """

    stroke: IntArray
    along: FloatArray
    half_mm: float

    @staticmethod
    def nothing(count: int) -> Stretch:
        """Leave nothing out at so many places."""
        return Stretch(np.zeros(count, np.int64), np.zeros(count), 0.0)


def axes_of(lines: ExpectedLines) -> Axes:
    """Lay points along all fresh lines, their ends included."""
    width = float(np.median(lines.width_mm[lines.fresh]))
    way = lines.end - lines.start
    length = np.linalg.norm(way, axis=1)
    begin = from_stroke_begin(lines.stroke, length)
    rows = np.flatnonzero(lines.fresh)
    count = np.maximum(2, np.ceil(length[rows] / (_APART * width)).astype(np.int64) + 1)
    own = np.repeat(rows, count)
    share = np.concatenate([np.linspace(0.0, 1.0, n) for n in count])
    at = lines.start[own, :2] + share[:, None] * way[own, :2]
    flat = np.linalg.norm(way[own, :2], axis=1)
    half = 0.5 * flat / np.repeat(count - 1, count)
    piece = np.column_stack([np.where(share > 0, -half, 0.0), np.where(share < 1, half, 0.0)])
    ahead = way[own, :2] / np.maximum(flat, 1e-9)[:, None]
    along = begin[own] + share * length[own]
    low = at.min(axis=0)
    side = max(_CELL * width, float(np.ptp(at, axis=0).max()) / _MOST_CELLS)
    column, row = ((at - low) / side).astype(np.int64).T
    columns, cells = int(column.max()) + 1, (int(row.max()) + 1) * (int(column.max()) + 1)
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(cells + 1))
    bounds = np.column_stack([first[:-1].reshape(-1, columns), first[columns::columns]])
    return Axes(
        at[order], ahead[order], piece[order], lines.stroke[own][order], along[order],
        bounds, low, side, float(half.max()),
    )  # fmt: skip


@jit
def nearest_axis(
    axes: Axes, x: float, y: float, within: float, stroke: int, along: float, half: float
) -> tuple[float, float, float]:
    """Return a place's distance from the nearest piece, mm, and the vector from there.

    The distance is infinite where none lies ``within``, mm; of the stroke what lies nearer than
    ``half`` along it isn't looked at.
    """
    reach = int((within + axes.longest) / axes.side) + 1
    rows, columns = axes.first.shape[0], axes.first.shape[1] - 1
    column = int(np.floor((x - axes.low[0]) / axes.side))
    row = int(np.floor((y - axes.low[1]) / axes.side))
    best, to_x, to_y = within * within, 0.0, 0.0
    found = False
    left, right = max(column - reach, 0), min(column + reach, columns - 1)
    for i in range(max(row - reach, 0), min(row + reach, rows - 1) + 1):
        if left > right:
            break
        for k in range(axes.first[i, left], axes.first[i, right + 1]):
            if axes.stroke[k] == stroke and abs(axes.along[k] - along) < half:
                continue
            dx, dy = x - axes.at[k, 0], y - axes.at[k, 1]
            t = dx * axes.ahead[k, 0] + dy * axes.ahead[k, 1]
            t = min(max(t, axes.piece[k, 0]), axes.piece[k, 1])
            dx -= t * axes.ahead[k, 0]
            dy -= t * axes.ahead[k, 1]
            square = dx * dx + dy * dy
            if square <= best:
                best, to_x, to_y, found = square, dx, dy, True
    return (np.sqrt(best) if found else np.inf), to_x, to_y


@jit
def are_near(axes: Axes, at: FloatArray, within: float) -> BoolArray:
    """Whether places (k, 2), mm, lie within so many mm of a line, (k,)."""
    out = np.zeros(len(at), np.bool_)
    for k in range(len(at)):
        far, _, _ = nearest_axis(axes, at[k, 0], at[k, 1], within, 0, 0.0, 0.0)
        out[k] = far < np.inf
    return out
