"""Write the rows of a `network.csv` as text within a kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.network_files.csv_format.float_text import (
    LONGEST,
    put_float,
    put_natural,
    put_text,
)
from kernels import jit
from kernels.arrays import IntArray

LONGEST_ROW: Final = 4 * 20 + 8 * LONGEST + 40 + 13
"""Characters of a row at most: whole numbers, floats, a vessel's kind, commas."""

_COMMA, _END, _MINUS = (np.uint8(ord(one)) for one in ",\n-")


class Columns(NamedTuple):
    """What rows are made of; n pieces, p points, v vessels.

    Attributes
    ----------
    vessel, first : (n,) int64
        Of each piece, and the point that it begins at.
    number : (p,) int64
        Node number of each point.
    points, radius : (p, 3), (p,) uint64
        Bits of the floats, mm.
    kind, tree : (v,) int64
    names, sizes : (k, w) uint8, (k,) int64
        Of the kinds.
    """

    vessel: IntArray
    first: IntArray
    number: IntArray
    points: NDArray[np.uint64]
    radius: NDArray[np.uint64]
    kind: IntArray
    tree: IntArray
    names: NDArray[np.uint8]
    sizes: IntArray


def texts(words: Sequence[str]) -> tuple[NDArray[np.uint8], IntArray]:
    """Bytes of words, (k, w), and how long each is, (k,)."""
    sizes = np.array([len(word.encode()) for word in words])
    width = int(sizes.max())
    names = np.frombuffer(b"".join(word.encode().ljust(width) for word in words), np.uint8)
    return names.reshape(len(words), width).copy(), sizes


@jit
def put_rows(out: Any, columns: Columns, begin: int, end: int, powers: Any) -> int:
    """Write rows ``begin`` to ``end`` into ``out`` (uint8); return their size in bytes."""
    c = columns
    at = 0
    for row in range(begin, end):
        vessel, first = c.vessel[row], c.first[row]
        at = _put_integer(out, at, vessel)
        for point in (first, first + 1):
            at = _put_integer(out, at, c.number[point])
        for point in (first, first + 1):
            for axis in range(3):
                at = put_float(out, at, c.points[point, axis], powers)
                out[at] = _COMMA
                at += 1
        for point in (first, first + 1):
            at = put_float(out, at, c.radius[point], powers)
            out[at] = _COMMA
            at += 1
        kind = c.kind[vessel]
        at = put_text(out, at, c.names[kind], c.sizes[kind])
        out[at] = _COMMA
        at = _put_integer(out, at + 1, c.tree[vessel])
        out[at - 1] = _END
    return at


@jit
def _put_integer(out: Any, at: int, value: int) -> int:
    """Write a whole number and a comma."""
    if value < 0:
        out[at] = _MINUS
        at += 1
        value = -value
    at = put_natural(out, at, value)
    out[at] = _COMMA
    return at + 1
