"""Filter target points to those inside the tissue, in Z-order; renumber segments depth first."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.tissue.columns import GridArrays
from design.tissue.grid import read
from kernels import jit


class Samples(NamedTuple):
    """Points to grow to, as kernels take them.

    Attributes
    ----------
    at : (n, 3) float64, mm
    near : (n,) float64
        Least distance from the tree there over that for the mean demand; 0 for a point that must
        be reached.
    flow : (n,) float64
        Of a terminal there, over the mean terminal's.
    """

    at: NDArray[np.float64]
    near: NDArray[np.float64]
    flow: NDArray[np.float64]


def plain_samples(points: NDArray[np.float64]) -> Samples:
    """Points of equal demand and flow."""
    ones = np.ones(len(points))
    return Samples(points, ones, ones)


@jit
def inside(grid: GridArrays, points: Any, low: Any, high: Any, in_order: bool) -> Any:
    """Those of ``points`` (n, 3) inside the tissue.

    With ``in_order`` along a Z-order curve of 1024 cells a side, else in the order given.

    Sorted points visit the same part of the tree one after another: beyond some 100,000
    segments, growth in random order waits for memory most of the time.
    """
    kept = np.empty(len(points), np.int64)
    code = np.empty(len(points), np.int64)
    size = 0
    scale = 1024.0 / (high - low)
    for n in range(len(points)):
        p = points[n]
        if read(grid, p[0], p[1], p[2]) < 0.0:
            kept[size] = n
            value = 0
            for axis in range(3):
                value |= _spread_bits(int((p[axis] - low[axis]) * scale[axis])) << axis
            code[size] = value
            size += 1
    # Codes of points in the same cell differ in their last digits: the order has no ties.
    order = np.arange(size)
    if in_order:
        order = np.argsort(code[:size] * len(points) + kept[:size])
    result = np.empty((size, 3))
    for n in range(size):
        result[n] = points[kept[order[n]]]
    return result


@jit
def _spread_bits(value: int) -> int:
    """Bits of a number below 1024, two zeros between each."""
    value = min(max(value, 0), 1023)
    value = (value | (value << 16)) & 0x030000FF
    value = (value | (value << 8)) & 0x0300F00F
    value = (value | (value << 4)) & 0x030C30C3
    return (value | (value << 2)) & 0x09249249


@jit
def depth_first(segments: Any, count: int) -> Any:
    """Renumber segments so that each is followed by its branch; a copy of the array."""
    order = np.empty(count, np.int32)
    number = np.full(count + 1, -1, np.int32)
    stack = np.empty(count, np.int32)
    stack[0] = 0
    top = 1
    size = 0
    while top > 0:
        top -= 1
        i = stack[top]
        order[size] = i
        number[i] = size
        size += 1
        if segments[i].left >= 0:
            if segments[i].right >= 0:
                stack[top] = segments[i].right
                top += 1
            stack[top] = segments[i].left
            top += 1
    result = segments.copy()
    for n in range(count):
        result[n] = segments[order[n]]
        s = result[n]
        # number[-1] is -1: no parent, no child.
        s.parent, s.left, s.right = number[s.parent], number[s.left], number[s.right]
    return result
