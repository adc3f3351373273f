"""Elements found by where they lie in the plan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.toolpath import FloatArray, IntArray

MAX_CELLS = 4_000_000


class Squares(NamedTuple):
    """Elements by squares of the plan, those of square s in ``member[begin[s]:begin[s + 1]]``.

    What lies within the pitch of a place is found in the nine squares about it.
    """

    origin: FloatArray
    pitch: float
    shape: IntArray
    begin: IntArray
    member: IntArray


def squares_of(elements: Elements, shaft_mm: float) -> Squares:
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
    return Squares(origin, pitch, shape, begin, np.argsort(square, kind="stable"))
