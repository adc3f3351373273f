"""Check a triangle mesh's topology: faulty edges, closedness, shells and genus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.solids.twins import corner_fan_numbers, count_shells, pair_half_edges
from kernels.arrays import IntArray


@dataclass(frozen=True)
class EdgeFaults:
    """Edges that a closed, oriented surface doesn't have.

    Attributes
    ----------
    open : int
        With a face on one side only.
    wrong : int
        With more than two faces, or with two that walk it in the same direction.
    """

    open: int
    wrong: int

    def __bool__(self) -> bool:
        return self.open + self.wrong > 0


def is_closed(faces: NDArray[np.integer], *, touching: bool = False) -> bool:
    """Whether each edge of ``faces`` (m, 3) is walked once in either direction.

    With ``touching`` as often in one as in the other: sheets may share an edge.
    """
    if not touching:
        return not bool(np.any(pair_half_edges(faces) < 0))
    tail = np.asarray(faces, dtype=np.int64)
    head = np.roll(tail, -1, axis=1).ravel()
    tail = tail.ravel()
    count = int(tail.max(initial=0)) + 1
    there, back = np.sort(tail * count + head), np.sort(head * count + tail)
    return bool(np.array_equal(there, back))


def edge_faults(faces: NDArray[np.integer]) -> EdgeFaults:
    """Count the faulty edges of ``faces`` (m, 3)."""
    if is_closed(faces):
        return EdgeFaults(0, 0)
    edge, forward = _half_edges(faces)
    _, index = np.unique(edge, return_inverse=True)
    walks = np.bincount(index)
    along = np.bincount(index, weights=forward)
    single = walks == 1
    return EdgeFaults(int(single.sum()), int(np.sum(~single & ((walks != 2) | (along != 1)))))


def faulty_vertices(faces: NDArray[np.integer]) -> IntArray:
    """Vertices of all edges that more or fewer than two faces share."""
    edge, _ = _half_edges(faces)
    keys, walks = np.unique(edge, return_counts=True)
    count = int(faces.max(initial=0)) + 1
    wrong = keys[walks != 2]
    return np.unique(np.r_[wrong // count, wrong % count])


def surface_genus(faces: NDArray[np.integer]) -> tuple[int, int]:
    """Total genus and number of shells of a closed, oriented surface.

    Euler: Σ (2 - 2 g) over the shells = vertices - edges + faces with edges = 3/2 faces. A vertex
    is a closed fan of triangle corners here: one in which two fans touch counts twice, as two
    shells that touch in a point are still two.

    Parameters
    ----------
    faces : (m, 3)
        Without `edge_faults`.
    """
    twin = pair_half_edges(faces)
    _, fans = corner_fan_numbers(twin)
    euler = fans - len(faces) // 2
    shells = int(count_shells(twin))
    return shells - euler // 2, shells


def corner_fans(faces: NDArray[np.integer]) -> IntArray:
    """Number of the fan that each corner (m, 3) of a closed surface belongs to.

    A vertex in which two fans touch has two numbers, so that one may be changed without the other.
    """
    fan, _ = corner_fan_numbers(pair_half_edges(faces))
    return np.asarray(fan).reshape(-1, 3)


def _half_edges(faces: NDArray[np.integer]) -> tuple[IntArray, NDArray[np.bool_]]:
    """Key of the undirected edge that leaves each corner (3m,), and whether it is walked up."""
    tail = np.asarray(faces, dtype=np.int64)
    head = np.roll(tail, -1, axis=1).ravel()
    tail = tail.ravel()
    count = int(tail.max(initial=0)) + 1
    return np.minimum(tail, head) * count + np.maximum(tail, head), tail < head
