"""Find parents, children and Strahler orders of a network's vessels, of kinds without loops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from design.network import VesselKind, VesselNetwork
from kernels import jit
from kernels.arrays import IntArray


@dataclass(frozen=True)
class Forest:
    """Vessels that branch from roots without loops, with the flow or against it (veins).

    Attributes
    ----------
    vessels : (k,) int64
        Their numbers in the network.
    parent : (k,) int64
        Place of each one's parent among ``vessels``, -1 for a root.
    order : (k,) int64
        Places such that parents come before children.
    """

    vessels: IntArray
    parent: IntArray
    order: IntArray


def forest_of(network: VesselNetwork, kind: VesselKind) -> Forest | None:
    """The forest of the vessels of ``kind``; None where they have loops, or there are none."""
    vessels = np.flatnonzero(network.kind == kind)
    ends = network.vessel_nodes[vessels]
    for near, far in ((0, 1), (1, 0)):
        reached = np.bincount(ends[:, far], minlength=len(network.nodes))
        if len(vessels) == 0 or reached.max() > 1:
            continue
        into = np.full(len(network.nodes), -1)
        into[ends[:, far]] = np.arange(len(vessels))
        parent = into[ends[:, near]]
        order = _parents_first(parent)
        if len(order) == len(vessels):
            return Forest(vessels, parent, order)
    return None


@jit
def _parents_first(parent: Any) -> Any:
    """Places that can be reached from the roots, parents before children."""
    size = len(parent)
    eldest = np.full(size, -1)
    sibling = np.full(size, -1)
    for i in range(size - 1, -1, -1):
        if parent[i] >= 0:
            sibling[i] = eldest[parent[i]]
            eldest[parent[i]] = i
    order = np.empty(size, np.int64)
    stack = np.empty(size, np.int64)
    count = 0
    for root in range(size):
        if parent[root] >= 0:
            continue
        stack[0] = root
        top = 1
        while top > 0:
            top -= 1
            i = stack[top]
            order[count] = i
            count += 1
            child = eldest[i]
            while child >= 0:
                stack[top] = child
                top += 1
                child = sibling[child]
    return order[:count]


@jit
def strahler_orders(parent: Any, order: Any) -> Any:
    """Order of each vessel: 1 for terminals; where two of the highest meet, one more.

    Strahler 1957, doi 10.1029/TR038i006p00913.

    Parameters
    ----------
    parent, order : (k,) int64
        As in `Forest`.
    """
    size = len(parent)
    rank = np.ones(size, np.int64)
    highest = np.zeros(size, np.int64)
    shared = np.zeros(size, np.bool_)
    for k in range(size - 1, -1, -1):
        i = order[k]
        if highest[i] > 0:
            rank[i] = highest[i] + (1 if shared[i] else 0)
        p = parent[i]
        if p < 0:
            continue
        if rank[i] > highest[p]:
            highest[p] = rank[i]
            shared[p] = False
        elif rank[i] == highest[p]:
            shared[p] = True
    return rank


@jit
def elements_of(parent: Any, order: Any, rank: Any, diameter: Any) -> Any:
    """Element of each vessel: vessels of one order in series; at a fork the widest goes on.

    Numbers count from 0, parents' before children's.
    """
    size = len(parent)
    heir = np.full(size, -1)
    for k in range(size):
        i = order[k]
        p = parent[i]
        if p < 0 or rank[p] != rank[i]:
            continue
        if heir[p] < 0 or diameter[i] > diameter[heir[p]]:
            heir[p] = i
    element = np.empty(size, np.int64)
    count = 0
    for k in range(size):
        i = order[k]
        if parent[i] >= 0 and heir[parent[i]] == i:
            element[i] = element[parent[i]]
        else:
            element[i] = count
            count += 1
    return element
