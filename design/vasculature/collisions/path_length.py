"""Compute the shortest path along the vessels between given pairs of a network's pieces."""

from __future__ import annotations

from heapq import heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels import jit


def ways_between(
    pairs: NDArray[np.int64],
    limit: NDArray[np.float64],
    ends: NDArray[np.int64],
    length: NDArray[np.float64],
    nodes: int,
) -> NDArray[np.float64]:
    """Shortest way along the vessels between the nearest ends of two pieces.

    Parameters
    ----------
    pairs : (k, 2) int64
        Pieces.
    limit : (k,) float64, mm
        Ways beyond it aren't followed.
    ends : (n, 2) int64
        Nodes at the ends of each piece.
    length : (n,) float64, mm
    nodes : int
        How many there are.

    Returns
    -------
    (k,) float64, mm
        inf where there is no way within the limit.
    """
    if len(pairs) == 0:
        return np.empty(0)
    order = np.argsort(ends.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(ends.ravel(), minlength=nodes))])
    way: NDArray[np.float64] = _ways(pairs, limit, ends, length, first, order // 2)
    return way


@jit
def _ways(pairs: Any, limit: Any, ends: Any, length: Any, first: Any, piece: Any) -> Any:
    """Dijkstra from both ends of each first piece, bounded by the pair's limit."""
    result = np.full(len(pairs), np.inf)
    best = np.full(len(first) - 1, np.inf)
    for k in range(len(pairs)):
        one, two = pairs[k]
        heap = [(0.0, ends[one, 0]), (0.0, ends[one, 1])]
        touched = [ends[one, 0], ends[one, 1]]
        best[ends[one, 0]] = 0.0
        best[ends[one, 1]] = 0.0
        while len(heap) > 0:
            way, node = heappop(heap)
            if way > best[node]:
                continue
            if node == ends[two, 0] or node == ends[two, 1]:
                result[k] = way
                break
            for at in range(first[node], first[node + 1]):
                p = piece[at]
                other = ends[p, 0] + ends[p, 1] - node
                further = way + length[p]
                if further <= limit[k] and further < best[other]:
                    best[other] = further
                    touched.append(other)
                    heappush(heap, (further, other))
        for node in touched:
            best[node] = np.inf
    return result
