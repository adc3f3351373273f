"""Parents and children of vessels in a tree network."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.read_network import IntArray, Pieces


def parents(net: Pieces) -> IntArray:
    """The piece that enters each piece's first node, (n,), or -1."""
    entering = np.full(net.node_count, -1, dtype=np.int64)
    entering[net.node[:, 1]] = np.arange(net.count)
    return entering[net.node[:, 0]]


@compiled
def from_roots(parent: Any) -> Any:
    """Pieces ordered so that parents come first; fewer than all where there is a cycle."""
    waiting = np.zeros(len(parent), np.int64)
    for p in parent:
        if p >= 0:
            waiting[p] += 1
    order, behind = np.empty(len(parent), np.int64), 0
    for i in range(len(parent)):
        if waiting[i] == 0:
            order[behind] = i
            behind += 1
    at = 0
    while at < behind:
        p = parent[order[at]]
        at += 1
        if p >= 0:
            waiting[p] -= 1
            if waiting[p] == 0:
                order[behind] = p
                behind += 1
    return order[:behind][::-1].copy()
