"""Order in which the vessels of a grown network appear, for growth animations."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from design.errors import NetworkError
from design.geometry.mesh import connected_parts
from design.measures.paths import paths_from
from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class GrowthOrder:
    """When each vessel comes.

    Attributes
    ----------
    generation : (v,) int64
        0 for vessels at an inlet (of veins and lymph, at an outlet), one more after each joint;
        a connection's is one more than its terminals'.
    terminal : (v,) float64 or None
        Of vessels that end as terminals, when they come: shares of their tree's terminals, above
        0 to 1. NaN for other vessels; None for networks that aren't trees.
    parent : (v,) int64 or None
        The vessel before each, towards its tree's root; -1 for a root, and for connections.
    """

    generation: IntArray
    terminal: FloatArray | None
    parent: IntArray | None

    def drawn(self, share: float) -> FloatArray:
        """Part of each vessel's terminals that are there at a share of all, (v,).

        A connection is there (1) once all terminals that it joins are.

        Raises
        ------
        NetworkError
            For a network that isn't trees.
        """
        if self.terminal is None or self.parent is None:
            raise NetworkError(
                "the network isn't trees, so that no terminals came one by one; take generations"
            )
        ends = np.isfinite(self.terminal)
        there = np.where(ends, self.terminal <= share + 1e-12, 0.0)
        every = ends.astype(np.float64)
        # From the last generation up: each vessel hands what it leads to to the one before it.
        for vessels in _from_below(self.parent):
            before = self.parent[vessels]
            np.add.at(there, before, there[vessels])
            np.add.at(every, before, every[vessels])
        return np.divide(there, every, out=np.zeros(len(there)), where=every > 0.0)


def growth_order(network: VesselNetwork) -> GrowthOrder:
    """Find when each vessel of a grown network came.

    A grown tree numbers its vessels as they come: each step parts one and adds a lower half and a
    terminal behind all others. Taking steps back, the last vessel that ends as a terminal is the
    one that came last, and the halves become one again.

    Notes
    -----
    Vessels are where they are in the finished network; while it grew, those that were parted later
    ran straight.
    """
    joins = network.kind == VesselKind.CONNECTION
    drains = np.isin(network.kind, (VesselKind.VEIN, VesselKind.LYMPH))
    ends = np.where(drains[:, None], network.vessel_nodes[:, ::-1], network.vessel_nodes)
    parent = _parents(ends, joins, len(network.nodes))
    if parent is None:
        depth, _, _ = paths_from(network, network.inlets())
        return GrowthOrder(np.maximum(depth[network.vessel_nodes].min(axis=1), 0), None, None)
    terminal = _removal(parent, joins)
    generation = _generations(parent)
    for vessels, tips in _connected(network, joins):
        generation[vessels] = 1 + generation[tips].max(initial=0)
        terminal[vessels] = np.nanmax(terminal[tips], initial=0.0)
    return GrowthOrder(generation, terminal, parent)


def _parents(ends: IntArray, joins: IntArray, nodes: int) -> IntArray | None:
    """The vessel before each, -1 for roots and connections; None where there is no one such."""
    own = np.flatnonzero(~joins)
    if len(np.unique(ends[own, 1])) < len(own):
        return None
    at = np.full(nodes, -1, dtype=np.int64)
    at[ends[own, 1]] = own
    parent = np.where(joins, -1, at[ends[:, 0]])
    depth = sum(len(level) for level in _from_below(parent))
    return parent if depth == int((parent >= 0).sum()) else None


def _from_below(parent: IntArray) -> list[IntArray]:
    """Vessels with a parent, by their distance from the root, the farthest first."""
    levels, level = [], np.flatnonzero(parent < 0)
    children = np.argsort(parent, kind="stable")
    first = np.searchsorted(parent[children], np.arange(len(parent) + 1))
    while len(level):
        parts = [children[first[v] : first[v + 1]] for v in level.tolist()]
        level = np.concatenate(parts) if parts else level[:0]
        if len(level):
            levels.append(level)
    return levels[::-1]


def _generations(parent: IntArray) -> IntArray:
    """Joints before each vessel; where a vessel goes on as one other, there is none."""
    count = np.bincount(parent[parent >= 0], minlength=len(parent))
    generations = np.zeros(len(parent), dtype=np.int64)
    for level in reversed(_from_below(parent)):
        generations[level] = generations[parent[level]] + (count[parent[level]] > 1)
    return generations


def _removal(parent: IntArray, joins: IntArray) -> FloatArray:
    """When each vessel without a child came, as a share of its tree's; NaN elsewhere."""
    size = len(parent)
    up, key = parent.copy(), np.arange(size)
    below: list[set[int]] = [set() for _ in range(size)]
    for vessel in np.flatnonzero(parent >= 0).tolist():
        below[int(parent[vessel])].add(vessel)
    tree = _roots(parent)
    heap = [(-v, v) for v in range(size) if not below[v] and not joins[v]]
    total = np.bincount(tree[[v for _, v in heap]], minlength=size) if heap else np.zeros(size)
    left, came = total.copy(), np.full(size, np.nan)
    heapq.heapify(heap)
    while heap:
        number, vessel = heapq.heappop(heap)
        if -number != key[vessel] or np.isfinite(came[vessel]):
            continue
        own = int(tree[vessel])
        came[vessel] = left[own] / total[own]
        left[own] -= 1
        while True:
            above = int(up[vessel])
            if above < 0:
                break
            below[above].discard(vessel)
            if below[above]:
                break
            vessel = above
        if above < 0 or len(below[above]) > 1:
            continue
        # The last below takes its parent's place and number: the two were one.
        (kept,) = below[above]
        key[kept], up[kept] = key[above], up[above]
        if up[above] >= 0:
            below[int(up[above])].discard(above)
            below[int(up[above])].add(kept)
        if not below[kept]:
            heapq.heappush(heap, (-int(key[kept]), kept))
    return came


def _roots(parent: IntArray) -> IntArray:
    """The root above each vessel."""
    roots = np.arange(len(parent))
    for level in reversed(_from_below(parent)):
        roots[level] = roots[parent[level]]
    return roots


def _connected(network: VesselNetwork, joins: IntArray) -> list[tuple[IntArray, IntArray]]:
    """Connections that share a node of their own, and the terminals that they join."""
    own = np.flatnonzero(joins)
    if len(own) == 0:
        return []
    nodes = network.vessel_nodes
    part = connected_parts(nodes[own], len(network.nodes))
    trees = np.flatnonzero(~joins)
    parts = []
    for number in np.unique(part[nodes[own, 0]]):
        vessels = own[part[nodes[own, 0]] == number]
        tips = trees[(part[nodes[trees]] == number).any(axis=1)]
        parts.append((vessels, tips))
    return parts
