"""Path length between two pieces along the vessels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.read_network import Pieces


def ways_within(
    net: Pieces, pairs: NDArray[np.int64], limit: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether the shortest way between both pieces of each pair is within its limit, (k,).

    The way runs from an end of the one to an end of the other, over whatever vessels join them,
    loops included; pieces of unconnected trees have none.

    Parameters
    ----------
    net : Pieces
    pairs : (k, 2) int64
    limit : (k,) float64, mm
    """
    ends = net.node.ravel()
    order = np.argsort(ends, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=net.node_count))])
    within: NDArray[np.bool_] = _within(pairs, limit, net.node, net.length, first, order // 2)
    return within


@compiled
def _within(pairs: Any, limit: Any, node: Any, length: Any, first: Any, piece_at: Any) -> Any:
    """From both ends of one piece, relax nodes in turn until none gets nearer.

    A node whose way would exceed the limit isn't queued, so that only the surroundings of a pair
    are walked.
    """
    nodes = len(first) - 1
    stamp = np.full(nodes, -1, np.int64)
    way = np.empty(nodes)
    result = np.zeros(len(pairs), np.bool_)
    for k in range(len(pairs)):
        one, two = pairs[k, 0], pairs[k, 1]
        queue = [node[one, 0], node[one, 1]]
        for begin in queue:
            stamp[begin], way[begin] = k, 0.0
        at = 0
        while at < len(queue):
            here = queue[at]
            at += 1
            for entry in range(first[here], first[here + 1]):
                piece = piece_at[entry]
                there = node[piece, 0] + node[piece, 1] - here
                further = way[here] + length[piece]
                if further <= limit[k] and (stamp[there] != k or further < way[there]):
                    stamp[there], way[there] = k, further
                    queue.append(there)
        result[k] = stamp[node[two, 0]] == k or stamp[node[two, 1]] == k
    return result
