"""Tree of bounding boxes, to find boxes near a place.

The boxes are sorted along a Z-order curve (Morton 1966) and halved again and again. Node ``k`` of
level ``d`` (2^d <= k < 2^(d+1), the top is node 1) holds the sorted boxes from ``p n / 2^d`` to
``(p + 1) n / 2^d`` with p = k - 2^d, so that neither pointers nor ranges need be stored.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled

_PER_LEAF = 4


class BoxTree(NamedTuple):
    """Boxes sorted, and the boxes around them.

    Attributes
    ----------
    order : (n,) int64
        Number that the i-th box along the curve has in the caller's arrays.
    around : (2^(levels + 1), 6) float64
        Low and high corner of every node.
    levels : int
        Level of the leaves.
    """

    order: NDArray[np.int64]
    around: NDArray[np.float64]
    levels: int


def box_tree(low: NDArray[np.float64], high: NDArray[np.float64]) -> BoxTree:
    """Build the tree over boxes with corners ``low`` and ``high`` (n, 3)."""
    middle = (low + high) / 2
    span = float((middle.max(axis=0) - middle.min(axis=0)).max()) or 1.0
    cells = ((middle - middle.min(axis=0)) * ((2**21 - 1) / span)).astype(np.uint64)
    order = np.argsort(_curve(cells), kind="stable")
    levels = max(0, int(np.ceil(np.log2(len(low) / _PER_LEAF))))
    return BoxTree(order, _around(low, high, order, levels), levels)


@compiled
def _curve(cells: Any) -> Any:
    """Place along the curve: the bits of the three coordinates in turn."""
    place = np.zeros(len(cells), np.uint64)
    for i in range(len(cells)):
        for axis in range(3):
            for bit in range(21):
                on = (cells[i, axis] >> np.uint64(bit)) & np.uint64(1)
                place[i] |= on << np.uint64(3 * bit + axis)
    return place


@compiled
def first_in(node: int, level: int, n: int) -> int:
    """First sorted box of a node; that of ``node + 1`` is one behind its last."""
    return ((node - (1 << level)) * n) >> level


@compiled
def _around(low: Any, high: Any, order: Any, levels: int) -> Any:
    n = len(order)
    around = np.empty((2 << levels, 6))
    around[:, :3] = np.inf
    around[:, 3:] = -np.inf
    for node in range(1 << levels, 2 << levels):
        for at in range(first_in(node, levels, n), first_in(node + 1, levels, n)):
            for axis in range(3):
                around[node, axis] = min(around[node, axis], low[order[at], axis])
                around[node, axis + 3] = max(around[node, axis + 3], high[order[at], axis])
    for node in range((1 << levels) - 1, 0, -1):
        for axis in range(3):
            around[node, axis] = min(around[2 * node, axis], around[2 * node + 1, axis])
            around[node, axis + 3] = max(around[2 * node, axis + 3], around[2 * node + 1, axis + 3])
    return around


@compiled
def meets(around: Any, node: int, low: Any, high: Any) -> bool:
    """Whether a box with corners ``low`` and ``high`` meets a node's box."""
    for axis in range(3):
        if around[node, axis] > high[axis] or around[node, axis + 3] < low[axis]:
            return False
    return True
