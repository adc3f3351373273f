"""Sort bounding boxes into cells of a grid, for quick look-up of boxes near a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels import jit
from kernels.arrays import FloatArray, IntArray

_MOST_CELLS = 4_000_000


class Cells(NamedTuple):
    """Boxes by the cells that they reach into.

    Attributes
    ----------
    low : (3,) float64, mm
        Corner of the grid.
    size : float, mm
        Of a cell.
    shape : (3,) int64
    first : (cells + 1,) int64
        Where each cell's boxes begin in ``item``.
    item : (k,) int64
        Numbers of boxes.
    """

    low: FloatArray
    size: float
    shape: IntArray
    first: IntArray
    item: IntArray


def sort_boxes(low: FloatArray, high: FloatArray, size: float) -> Cells:
    """Sort boxes from ``low`` to ``high``, (n, 3) each, into cells of about ``size`` mm."""
    corner, span = low.min(axis=0), np.ptp(np.concatenate([low, high]), axis=0)
    size = max(size, float(np.cbrt(np.prod(span) / _MOST_CELLS)))
    shape = np.floor(span / size).astype(np.int64) + 1
    first = np.zeros(int(np.prod(shape)) + 1, np.int64)
    begin = np.floor((low - corner) / size).astype(np.int64)
    end = np.minimum(np.floor((high - corner) / size).astype(np.int64), shape - 1)
    _count(begin, end, shape, first)
    first = np.cumsum(first)
    item = np.empty(int(first[-1]), np.int64)
    _fill(begin, end, shape, first[:-1].copy(), item)
    return Cells(corner, size, shape, first, item)


@jit
def _count(begin: IntArray, end: IntArray, shape: IntArray, first: IntArray) -> None:
    for n in range(len(begin)):
        for i in range(begin[n, 0], end[n, 0] + 1):
            for j in range(begin[n, 1], end[n, 1] + 1):
                for k in range(begin[n, 2], end[n, 2] + 1):
                    first[(i * shape[1] + j) * shape[2] + k + 1] += 1


@jit
def _fill(begin: IntArray, end: IntArray, shape: IntArray, at: IntArray, item: IntArray) -> None:
    for n in range(len(begin)):
        for i in range(begin[n, 0], end[n, 0] + 1):
            for j in range(begin[n, 1], end[n, 1] + 1):
                for k in range(begin[n, 2], end[n, 2] + 1):
                    cell = (i * shape[1] + j) * shape[2] + k
                    item[at[cell]] = n
                    at[cell] += 1
