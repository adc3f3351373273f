"""Grow trunk vessels along a graph of points below a surface, each branch by the cheapest path."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from design.anatomy.layer import Layer
from design.errors import GrowthError
from kernels.arrays import FloatArray, IntArray

BESIDE = 3.0
"""Cost of going on beside a tree, over going away from it."""


@dataclass
class LayerForest:
    """Trees of places of a layer, one tree for each inlet.

    Attributes
    ----------
    layer : Layer
    balance : float
        0 to 1: how much the way back to the inlet counts beside a branch's own length. The
        cosine of the angle at which branches leave long straight trunks (Cuntz et al. 2010,
        doi 10.1371/journal.pcbi.1000877, balancing factor).
    cost : (e,) float64
        Of each edge of the layer.
    apart : float, mm
        Least distance of a new branch's end from the trees as they stand.
    parent, tree : (n,) int64
        Of each place; -2 and -1 where no tree has come.
    way : (n,) float64, mm
        From the inlet, along the tree.
    away : (n,) float64, mm
        Distance of each place from the nearest that has a tree.
    """

    layer: Layer
    balance: float
    cost: FloatArray
    apart: float
    parent: IntArray = field(init=False)
    tree: IntArray = field(init=False)
    way: FloatArray = field(init=False)
    away: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.layer.points)
        self.parent = np.full(count, -2, dtype=np.int64)
        self.tree = np.full(count, -1, dtype=np.int64)
        self.way = np.zeros(count)
        self.away = np.full(count, np.inf)

    def plant(self, tree: int, place: int) -> None:
        """Begin a tree at a place."""
        self._take(place, -1, tree)

    def extend(self, path: IntArray) -> None:
        """Go on from the last place of ``path`` that has a tree, along the rest of it."""
        taken = np.flatnonzero(self.parent[path] > -2)
        if not len(taken):
            raise GrowthError("a trunk's path doesn't begin on a tree; give its inlet a place")
        rest = path[taken[-1] :].tolist()
        for before, here in pairwise(rest):
            self._take(here, before, int(self.tree[before]))

    def join(self, sites: IntArray) -> None:
        """Join all of ``sites`` that are ``apart`` from the trees, the cheapest first."""
        left = sites[self.away[sites] > self.apart]
        while len(left):
            cost, before = self._ways()
            best = int(left[np.argmin(cost[left])])
            if not np.isfinite(cost[best]):
                return
            path = [best]
            while self.parent[path[-1]] == -2:
                path.append(int(before[path[-1]]))
            self.extend(np.array(path[::-1], dtype=np.int64))
            left = left[self.away[left] > self.apart]

    def _take(self, place: int, parent: int, tree: int) -> None:
        points = self.layer.points
        self.parent[place], self.tree[place] = parent, tree
        if parent >= 0:
            self.way[place] = self.way[parent] + float(
                np.linalg.norm(points[place] - points[parent])
            )
        self.away = np.minimum(self.away, np.linalg.norm(points - points[place], axis=1))

    def _ways(self) -> tuple[FloatArray, IntArray]:
        """Cost of joining each place, and the place before it on the way from the trees."""
        layer, count = self.layer, len(self.layer.points)
        begin = np.repeat(np.arange(count), np.diff(layer.first))
        near = np.minimum(self.away[begin], self.away[layer.to]) < 0.6 * self.apart
        cost = self.cost * np.where(near, BESIDE, 1.0)
        taken = np.flatnonzero(self.parent > -2)
        # All trees hang on one more place, each of theirs by its part of the way.
        first = np.append(layer.first, layer.first[-1] + len(taken))
        to = np.concatenate([layer.to, taken])
        weight = np.concatenate([cost, self.balance * self.way[taken] + 1e-9])
        graph = csr_matrix((weight, to, first), shape=(count + 1,) * 2)
        costs, before = dijkstra(graph, indices=count, return_predecessors=True)
        return costs[:count], before[:count].astype(np.int64)


def cheapest_path(layer: Layer, weight: FloatArray, start: int, end: int) -> IntArray:
    """Places from ``start`` to ``end`` where each edge's length times ``weight`` (n,) costs least.

    An edge's weight is the mean of its ends'.
    """
    begin = np.repeat(np.arange(len(layer.points)), np.diff(layer.first))
    cost = layer.length * 0.5 * (weight[begin] + weight[layer.to])
    graph = csr_matrix((cost, layer.to, layer.first), shape=(len(layer.points),) * 2)
    before = dijkstra(graph, indices=start, return_predecessors=True)[1]
    path = [end]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return np.array(path[::-1], dtype=np.int64)


def spread_sites(points: FloatArray, count: int, taken: FloatArray) -> IntArray:
    """So many of ``points`` (n, 3), each as far as can be from the others and from ``taken``."""
    away = np.full(len(points), np.inf)
    for place in taken:
        away = np.minimum(away, np.linalg.norm(points - place, axis=1))
    sites = []
    for _ in range(min(count, len(points))):
        site = int(np.argmax(away))
        sites.append(site)
        away = np.minimum(away, np.linalg.norm(points - points[site], axis=1))
    return np.array(sites, dtype=np.int64)


def apart_for(layer: Layer, ends: int) -> float:
    """Distance of branches at which so many ends cover the layer, mm."""
    near = cKDTree(layer.points).query(layer.points, 2)[0][:, 1]
    # A place of a random pattern has its nearest neighbour half the root of its area away.
    area = len(layer.points) * (2.0 * float(near.mean())) ** 2
    return 0.62 * float(np.sqrt(area / ends))
