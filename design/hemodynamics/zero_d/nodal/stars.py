"""Kernels that eliminate a graph's nodes by star-mesh steps, and recover their pressures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import IntArray

Numbers = NDArray[Any]
Small = NDArray[np.int32]


@jit
def fold_stars(
    order: Small,
    begin: IntArray,
    neighbour: Small,
    link: Small,
    pair: Small,
    weight: Numbers,
    ground: Numbers,
) -> tuple[Numbers, Numbers]:
    """Shares w_i/Σ of each step's neighbours (c,) and its Σ (k,).

    ``weight`` (l,) of links and ``ground`` (n,) gain what is folded onto them, in place.
    """
    share, total = np.empty(len(neighbour), weight.dtype), np.empty(len(order), weight.dtype)
    p = 0
    for k in range(len(order)):
        here = ground[order[k]]
        low, high = begin[k], begin[k + 1]
        whole = here
        for i in range(low, high):
            whole += weight[link[i]]
        total[k] = whole
        for i in range(low, high):
            w = weight[link[i]]
            share[i] = w / whole
            ground[neighbour[i]] += share[i] * here
            for j in range(low, i):
                weight[pair[p]] += w * share[j]
                p += 1
    return share, total


@jit
def gather_stars(
    order: Small, begin: IntArray, neighbour: Small, share: Numbers, source: Numbers
) -> None:
    """Carry sources (n,) of eliminated nodes to their neighbours, in place."""
    for k in range(len(order)):
        here = source[order[k]]
        for i in range(begin[k], begin[k + 1]):
            source[neighbour[i]] += share[i] * here


@jit
def unfold_stars(
    order: Small,
    begin: IntArray,
    neighbour: Small,
    share: Numbers,
    total: Numbers,
    source: Numbers,
    value: Numbers,
) -> None:
    """Values (n,) of eliminated nodes from their neighbours', last to first, in place."""
    for k in range(len(order) - 1, -1, -1):
        here = source[order[k]] / total[k]
        for i in range(begin[k], begin[k + 1]):
            here += share[i] * value[neighbour[i]]
        value[order[k]] = here
