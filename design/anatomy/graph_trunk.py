"""Trunks grown over a guiding layer: each new site joins where way and branch are short."""

from __future__ import annotations

from dataclasses import dataclass, field
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from design.anatomy.layer import Layer
from design.errors import GrowthError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
    parent, tree : (n,) int64
        Of each place; -2 and -1 where no tree has come.
    way : (n,) float64, mm
        From the inlet, along the tree.
    """

    layer: Layer
    balance: float
    cost: FloatArray
    parent: IntArray = field(init=False)
    tree: IntArray = field(init=False)
    way: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.layer.points)
        self.parent = np.full(count, -2, dtype=np.int64)
        self.tree = np.full(count, -1, dtype=np.int64)
        self.way = np.zeros(count)
        self._best = np.full(count, np.inf)
        self._from = np.full(count, -1, dtype=np.int64)

    def plant(self, tree: int, place: int) -> None:
        """Begin a tree at a place."""
        self._take(place, -1, tree)
        self._spread([place])

    def extend(self, path: IntArray) -> None:
        """Go on from the last place of ``path`` that has a tree, along the rest of it."""
        taken = np.flatnonzero(self.parent[path] > -2)
        if not len(taken):
            raise GrowthError("a trunk's path doesn't begin on a tree; give its inlet a place")
        fresh = []
        for before, here in zip(
            path[taken[-1] : -1].tolist(), path[taken[-1] + 1 :].tolist(), strict=True
        ):
            self._take(here, before, int(self.tree[before]))
            fresh.append(here)
        self._spread(fresh)

    def join(self, sites: IntArray) -> None:
        """Join all of ``sites``, each time the one that costs least."""
        left = [site for site in sites.tolist() if self.parent[site] == -2]
        while left:
            costs = self._best[left]
            at = int(np.argmin(costs))
            if not np.isfinite(costs[at]):
                return
            self.extend(self._path_to(left[at]))
            left = [site for site in left if self.parent[site] == -2]

    def _take(self, place: int, parent: int, tree: int) -> None:
        self.parent[place], self.tree[place] = parent, tree
        if parent >= 0:
            step = self.layer.points[place] - self.layer.points[parent]
            self.way[place] = self.way[parent] + float(np.linalg.norm(step))

    def _path_to(self, site: int) -> IntArray:
        path = [site]
        while self.parent[path[-1]] == -2:
            path.append(int(self._from[path[-1]]))
        return np.array(path[::-1], dtype=np.int64)

    def _spread(self, sources: list[int]) -> None:
        """Lower the costs of all places that are reached better from ``sources`` (Dijkstra)."""
        heap: list[tuple[float, int]] = []
        for place in sources:
            value = self.balance * float(self.way[place])
            self._best[place] = min(value, self._best[place])
            heappush(heap, (float(self._best[place]), place))
        first, to, cost, best = self.layer.first, self.layer.to, self.cost, self._best
        while heap:
            value, place = heappop(heap)
            if value > best[place]:
                continue
            for edge in range(first[place], first[place + 1]):
                other = int(to[edge])
                further = value + float(cost[edge])
                if further < best[other]:
                    best[other] = further
                    self._from[other] = place
                    heappush(heap, (further, other))


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
