"""Sort vessel elements into squares of the xy plane, for quick look-up of those near a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.toolpath.embedded.elements import Elements
from kernels import jit
from kernels.arrays import FloatArray, IntArray

MAX_CELLS = 4_000_000


class ElementSquares(NamedTuple):
    """Elements by squares of the plan, those of square s in ``member[begin[s]:begin[s + 1]]``.

    What lies within the pitch of a place is found in the nine squares about it.

    Attributes
    ----------
    around : (n, 4) float64, mm
        Of each member: x and y of its middle, its top, and how far its ink reaches from the middle.
        In the members' order, so that a search runs along memory.
    """

    origin: FloatArray
    pitch: float
    shape: IntArray
    begin: IntArray
    member: IntArray
    around: FloatArray


def squares_of(elements: Elements, shaft_mm: float) -> ElementSquares:
    """Elements by their middles, in squares so wide that the next ones hold all that is hit."""
    middle = elements.point[elements.end].mean(axis=1)[:, :2]
    origin, size = middle.min(axis=0), np.ptp(middle, axis=0)
    widest, longest = float(elements.radius.max()), float(elements.length.max())
    reach = max(shaft_mm, widest) + widest + longest
    pitch = max(reach, float(np.sqrt(size.prod() / MAX_CELLS)))
    place = np.floor((middle - origin) / pitch).astype(np.int64)
    shape = place.max(axis=0) + 1
    square = place[:, 0] * shape[1] + place[:, 1]
    begin = np.concatenate([[0], np.cumsum(np.bincount(square, minlength=int(shape.prod())))])
    member = np.argsort(square, kind="stable")
    thick = elements.radius.max(axis=1)
    top = elements.point[elements.end, 2].max(axis=1) + thick
    around = np.column_stack([middle, top, thick + elements.length / 2])
    return ElementSquares(origin, pitch, shape, begin, member, np.ascontiguousarray(around[member]))


@jit
def near(squares: ElementSquares, place: FloatArray, k: int) -> tuple[int, int]:
    """Range of `Squares.member` in the ``k``-th (0..2) of three rows of squares about a place."""
    x = int(np.floor((place[0] - squares.origin[0]) / squares.pitch)) - 1 + k
    y = int(np.floor((place[1] - squares.origin[1]) / squares.pitch))
    low, high = max(0, y - 1), min(squares.shape[1], y + 2)
    if x < 0 or x >= squares.shape[0] or low >= high:
        return 0, 0
    return squares.begin[x * squares.shape[1] + low], squares.begin[x * squares.shape[1] + high]
