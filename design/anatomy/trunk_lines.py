"""Lay trunk vessels along a graph of points below a tissue's surface, and smooth their lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from design.anatomy.curves import children_of
from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.growth.trunk import Trunk, straighten_line
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Layers(NamedTuple):
    """How places are joined to a layer, and trunks are laid along it."""

    links: int = 14  # neighbours that a place is joined to
    longest: float = 2.6  # edge over the mean distance of neighbours
    least: int = 10  # places that hang together
    beside: float = 3.0  # cost of going on beside a tree, over going away from it
    near: float = 0.6  # of the spacing, up to which a place is beside a tree
    smoothing: int = 40  # steps: bends of up to some six places are evened out, larger ones stay


LAYER = _Layers()
_TOO_FEW = (
    "the guiding layer has {} places that hang together; the tissue is too thin there for these "
    "vessels: ask for fewer terminals, a lower depth or a higher pressure drop"
)


@dataclass(frozen=True)
class Layer:
    """Places that trunks may run through.

    Edges of place ``i`` are ``first[i]:first[i + 1]`` of the arrays ``to`` and ``length``.
    """

    points: FloatArray  # (n, 3), mm
    first: IntArray  # (n + 1,)
    to: IntArray  # (e,)
    length: FloatArray  # (e,), mm

    @property
    def begin(self) -> IntArray:
        """Place (e,) at which each edge begins."""
        return np.repeat(np.arange(len(self.points)), np.diff(self.first))

    def graph(self, cost: FloatArray) -> csr_matrix:
        """Return the layer's graph with costs (e,) of its edges."""
        return csr_matrix((cost, self.to, self.first), shape=(len(self.points),) * 2)

    def nearest(self, place: FloatArray) -> int:
        """Return the place nearest to ``place`` (3,)."""
        return nearest(self.points, place)

    def below(self, entry: FloatArray, inward: FloatArray) -> int:
        """Return the place below one (3,) of the surface, two short edges along ``inward``."""
        return self.nearest(entry + 2.0 * float(np.percentile(self.length, 25)) * inward)


def nearest(points: FloatArray, place: FloatArray) -> int:
    """Return which of ``points`` (n, 3) is nearest to ``place`` (3,)."""
    return int(np.argmin(np.linalg.norm(points - place, axis=1)))


def join_layer(tissue: Tissue, points: FloatArray, least_depth_mm: float) -> Layer:
    """Join places to their neighbours by edges that stay below the surface.

    Only the largest part that hangs together is kept.

    Raises
    ------
    GrowthError
        When fewer than ten places hang together.
    """
    if len(points) < LAYER.least:
        raise GrowthError(_TOO_FEW.format(len(points)))
    away, near = cKDTree(points).query(points, min(LAYER.links + 1, len(points)))
    reach = LAYER.longest * float(away[:, 1:4].mean())
    start = np.repeat(np.arange(len(points)), near.shape[1] - 1)
    end, length = near[:, 1:].ravel(), away[:, 1:].ravel()
    kept = (length <= reach) & (length > 0.0)
    start, end, length = start[kept], end[kept], length[kept]
    inside = np.ones(len(start), dtype=np.bool_)
    for part in (0.25, 0.5, 0.75):
        between = points[start] + part * (points[end] - points[start])
        inside &= -tissue.grid.distance(between) >= least_depth_mm
    start, end, length = start[inside], end[inside], length[inside]
    links = coo_matrix((length, (start, end)), shape=(len(points),) * 2).tocsr()
    links = links.maximum(links.T)
    number = connected_components(links, directed=False)[1]
    largest = np.flatnonzero(number == np.argmax(np.bincount(number)))
    if len(largest) < LAYER.least:
        raise GrowthError(_TOO_FEW.format(len(largest)))
    links = links[largest][:, largest].tocsr()
    links.sort_indices()
    return Layer(
        np.ascontiguousarray(points[largest]),
        links.indptr.astype(np.int64),
        links.indices.astype(np.int64),
        links.data.astype(np.float64),
    )


def below_surface(
    tissue: Tissue, points: FloatArray, inward: FloatArray, depth_mm: float
) -> tuple[FloatArray, BoolArray]:
    """Return places ``depth_mm`` below ``points`` (n, 3), and which are indeed that deep."""
    below: FloatArray = points + depth_mm * inward
    return below, -tissue.grid.distance(below) >= 0.85 * depth_mm


class Zone(NamedTuple):
    """Size of a zone, mm to the power of its ``dimension``, over which places are spread."""

    size: float
    dimension: int

    @staticmethod
    def of(layer: Layer, dimension: int) -> Zone:
        """Return the area, or the volume, that a layer's places have at random."""
        near = float(cKDTree(layer.points).query(layer.points, 2)[0][:, 1].mean())
        # The nearest neighbour's mean distance is 0.5 of an area's root, 0.554 of a volume's.
        cell = (2.0 * near) ** 2 if dimension == 2 else (near / 0.554) ** 3
        return Zone(len(layer.points) * cell, dimension)

    def spacing_mm(self, count: int) -> float:
        """Return the edge of the square, or cube, that each of ``count`` places has."""
        return float((self.size / count) ** (1.0 / self.dimension))


class Rank(NamedTuple):
    """Branches of one rank of an organ's trunks."""

    # 0 to 1: how much the way back to the inlet counts beside a branch's own length. The cosine of
    # the angle at which branches leave long straight trunks (Cuntz et al. 2010,
    # doi 10.1371/journal.pcbi.1000877, balancing factor).
    balance: float
    spacing: float = 0.62  # least distance of a new end from the trees over that of all ends
    ends: int = 0  # how many; 0 for as many as the organ's trunks have
    offered: int = 1  # places that are tried for each end


@dataclass
class LayerForest:
    """Trees of places of a layer, one tree for each inlet."""

    layer: Layer
    parent: IntArray = field(init=False)  # (n,), -2 where no tree has come
    tree: IntArray = field(init=False)  # (n,), -1 where no tree has come
    way: FloatArray = field(init=False)  # (n,), mm, from the inlet along the tree
    away: FloatArray = field(init=False)  # (n,), mm, from the nearest place that has a tree

    def __post_init__(self) -> None:
        count = len(self.layer.points)
        self.parent = np.full(count, -2, dtype=np.int64)
        self.tree = np.full(count, -1, dtype=np.int64)
        self.way = np.zeros(count)
        self.away = np.full(count, np.inf)

    @property
    def taken(self) -> FloatArray:
        """Places (k, 3) that have a tree."""
        return self.layer.points[self.parent > -2]

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

    def grow(
        self,
        rank: Rank,
        ends: int,
        zone: Zone,
        among: IntArray | None = None,
        cost: FloatArray | None = None,
        far_from: FloatArray | None = None,
    ) -> None:
        """Grow branches of one rank.

        Parameters
        ----------
        ends : int
            Of the organ's trunks.
        among : (k,) int64, optional
            Places of the layer that may be ends.
        cost : (e,) float64, optional
            Of each edge of the layer; its length by default.
        far_from : (k, 3) float64, mm, optional
            Places from which ends lie far; the trees by default.
        """
        among = np.arange(len(self.layer.points)) if among is None else among
        far_from = self.taken if far_from is None else far_from
        ends = rank.ends or ends
        sites = spread_sites(self.layer.points[among], rank.offered * ends, far_from)
        cost = self.layer.length if cost is None else cost
        self.join(among[sites], rank.spacing * zone.spacing_mm(ends), rank.balance, cost)

    def join(self, sites: IntArray, spacing_mm: float, balance: float, cost: FloatArray) -> None:
        """Join all of ``sites`` that are ``spacing_mm`` from the trees, the cheapest first."""
        left = sites[self.away[sites] > spacing_mm]
        while len(left):
            costs, before = self._ways(spacing_mm, balance, cost)
            best = int(left[np.argmin(costs[left])])
            if not np.isfinite(costs[best]):
                return
            path = [best]
            while self.parent[path[-1]] == -2:
                path.append(int(before[path[-1]]))
            self.extend(np.array(path[::-1], dtype=np.int64))
            left = left[self.away[left] > spacing_mm]

    def _take(self, place: int, parent: int, tree: int) -> None:
        points = self.layer.points
        self.parent[place], self.tree[place] = parent, tree
        if parent >= 0:
            self.way[place] = self.way[parent] + float(
                np.linalg.norm(points[place] - points[parent])
            )
        self.away = np.minimum(self.away, np.linalg.norm(points - points[place], axis=1))

    def _ways(
        self, spacing_mm: float, balance: float, cost: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Return cost of joining each place, and the place before it on the way from the trees."""
        layer, count = self.layer, len(self.layer.points)
        near = np.minimum(self.away[layer.begin], self.away[layer.to]) < LAYER.near * spacing_mm
        taken = np.flatnonzero(self.parent > -2)
        # All trees hang on one more place, each of theirs by its part of the way.
        first = np.append(layer.first, layer.first[-1] + len(taken))
        to = np.concatenate([layer.to, taken])
        weight = np.concatenate(
            [cost * np.where(near, LAYER.beside, 1.0), balance * self.way[taken] + 1e-9]
        )
        graph = csr_matrix((weight, to, first), shape=(count + 1,) * 2)
        costs, before = dijkstra(graph, indices=count, return_predecessors=True)
        return costs[:count], before[:count].astype(np.int64)


def cheapest_path(layer: Layer, weight: FloatArray, start: int, end: int) -> IntArray:
    """Return places of the path whose edges' lengths times ``weight`` (n,) cost least.

    An edge's weight is the mean of its ends'.
    """
    cost = layer.length * 0.5 * (weight[layer.begin] + weight[layer.to])
    before = dijkstra(layer.graph(cost), indices=start, return_predecessors=True)[1]
    path = [end]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return np.array(path[::-1], dtype=np.int64)


def spread_sites(points: FloatArray, count: int, taken: FloatArray) -> IntArray:
    """Choose so many of ``points`` (n, 3), far from each other and from ``taken`` (k, 3)."""
    away = np.full(len(points), np.inf)
    for place in taken:
        away = np.minimum(away, np.linalg.norm(points - place, axis=1))
    sites = []
    for _ in range(min(count, len(points))):
        site = int(np.argmax(away))
        sites.append(site)
        away = np.minimum(away, np.linalg.norm(points - points[site], axis=1))
    return np.array(sites, dtype=np.int64)


@dataclass(frozen=True)
class TrunkLines:
    """Trunks as trees of nodes, several in one, parents before their children."""

    points: FloatArray  # (n, 3), mm
    parent: IntArray  # -1 for an inlet
    tree: IntArray
    share: FloatArray  # of the tissue's volume nearest to a node or one downstream of it

    def main_child(self) -> IntArray:
        """Return the child of each node with the largest share; -1 at tips."""
        main = np.full(len(self.parent), -1, dtype=np.int64)
        # Last to be written is the largest; equal ones by number.
        for i in np.argsort(self.share, kind="stable"):
            if self.parent[i] >= 0:
                main[self.parent[i]] = i
        return main

    def child_count(self) -> IntArray:
        """Return how many children each node has."""
        below = self.parent[self.parent >= 0]
        return np.bincount(below, minlength=len(self.parent))


def lines_of(forest: LayerForest, ostia: dict[int, FloatArray], volume: FloatArray) -> TrunkLines:
    """Return the trees' nodes in order, parents first, each tree's ostium before its first place.

    A place of three children or more is parted into several along its main child's edge.

    Each tree's number has its ostium (3,), mm; shares are measured by points ``volume`` (k, 3)
    all over the tissue.
    """
    used = np.flatnonzero(forest.parent > -2)
    # Parents have shorter ways, so that they stand first.
    order = used[np.argsort(forest.way[used], kind="stable")]
    inlets = np.array(sorted(ostia))
    number = np.full(len(forest.parent), -1, dtype=np.int64)
    number[order] = len(inlets) + np.arange(len(order))
    up, trees = forest.parent[order], forest.tree[order]
    enters = np.searchsorted(inlets, trees)
    lines = TrunkLines(
        np.concatenate([[ostia[tree] for tree in inlets], forest.layer.points[order]]),
        np.concatenate([np.full(len(inlets), -1), np.where(up >= 0, number[up], enters)]),
        np.concatenate([inlets, trees]),
        np.zeros(len(inlets) + len(order)),
    )
    return with_shares(_binary(with_shares(lines, volume)), volume)


def with_shares(lines: TrunkLines, volume: FloatArray) -> TrunkLines:
    """Return the lines with their shares of ``volume`` (k, 3) measured."""
    own = np.bincount(cKDTree(lines.points).query(volume)[1], minlength=len(lines.points))
    share = own.astype(np.float64)
    for i in range(len(share) - 1, -1, -1):
        if lines.parent[i] >= 0:
            share[lines.parent[i]] += share[i]
    return replace(lines, share=share / len(volume))


def _binary(lines: TrunkLines) -> TrunkLines:
    """Return part places of three children or more: all but two move down the main child's edge."""
    main, count = lines.main_child(), lines.child_count()
    points, parent, tree = lines.points.tolist(), lines.parent.copy(), lines.tree.tolist()
    more: list[int] = []
    for node in np.flatnonzero(count > 2).tolist():
        heir = int(main[node])
        others = [c for c in np.flatnonzero(lines.parent == node).tolist() if c != heir]
        others.sort(key=lambda child: -lines.share[child])
        above = node
        for n, child in enumerate(others[1:]):
            part = (n + 1) / len(others)
            place = (1 - part) * lines.points[node] + part * lines.points[heir]
            points.append(place.tolist())
            more.append(above)
            tree.append(int(lines.tree[node]))
            above = len(points) - 1
            parent[child] = above
        parent[heir] = above
    up = np.concatenate([parent, np.array(more, dtype=np.int64)])
    return in_order(TrunkLines(np.array(points), up, np.array(tree), np.zeros(len(up))))[1]


def in_order(lines: TrunkLines) -> tuple[IntArray, TrunkLines]:
    """Return the order of nodes in which parents come before children, and the lines so put."""
    depth = np.zeros(len(lines.parent), dtype=np.int64)
    above = lines.parent.copy()
    while (above >= 0).any():
        depth += above >= 0
        above = np.where(above >= 0, lines.parent[above], -1)
    order = np.argsort(depth, kind="stable")
    return order, _chosen(lines, order, lines.parent)


def without(lines: TrunkLines, gone: BoolArray) -> TrunkLines:
    """Return the lines without some nodes; all below these must be among them."""
    return _chosen(lines, np.flatnonzero(~gone), lines.parent)


def _chosen(lines: TrunkLines, nodes: IntArray, parent: IntArray) -> TrunkLines:
    """Return some nodes in their order, each with its ``parent`` (n,) among them."""
    number = np.full(len(parent) + 1, -1, dtype=np.int64)  # the last one stands for no parent
    number[nodes] = np.arange(len(nodes))
    return TrunkLines(
        lines.points[nodes], number[parent[nodes]], lines.tree[nodes], lines.share[nodes]
    )


def smooth_lines(
    tissue: Tissue,
    lines: TrunkLines,
    depth_mm: FloatArray,
    exactly: bool = True,
    zone: Callable[[FloatArray], FloatArray] | None = None,
) -> TrunkLines:
    """Even out bends: each node moves halfway to the middle of its parent and main child.

    Each time nodes but inlets are brought to a depth (n,), or at least there; and into a zone.
    """
    main = lines.main_child()
    inner = np.flatnonzero((lines.parent >= 0) & (main >= 0))
    points, inlet = lines.points.copy(), lines.parent < 0
    for _ in range(LAYER.smoothing):
        middle = 0.5 * (points[lines.parent[inner]] + points[main[inner]])
        points[inner] += 0.5 * (middle - points[inner])
        for _ in range(2):
            off = -tissue.grid.distance(points) - depth_mm
            off = np.where(inlet, 0.0, off if exactly else np.minimum(off, 0.0))
            points = points + off[:, None] * outward(tissue, points)
        if zone is not None:
            points = np.where(inlet[:, None], points, zone(points))
    return replace(lines, points=points)


def thinned(lines: TrunkLines, tolerance_mm: FloatArray) -> TrunkLines:
    """Return the lines without nodes that lie within a tolerance (n,) of the straight beside them.

    Inlets, joints and tips stay; of each run between them Douglas and Peucker's points.
    """
    count, main = lines.child_count(), lines.main_child()
    ends = (lines.parent < 0) | (count != 1)
    kept = ends.copy()
    for begin in np.flatnonzero(ends).tolist():
        for child in np.flatnonzero(lines.parent == begin).tolist():
            run = [begin, child]
            while not ends[run[-1]]:
                run.append(int(main[run[-1]]))
            stays, _ = straighten_line(lines.points[run], float(tolerance_mm[run].min()))
            kept[np.array(run)[stays]] = True
    above = lines.parent.copy()
    while (skip := (above >= 0) & ~kept[above]).any():
        above[skip] = lines.parent[above[skip]]
    return _chosen(lines, np.flatnonzero(kept), above)


def outward(tissue: Tissue, points: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) in which the signed distance rises; 0 where it is flat."""
    h = tissue.grid.spacing_mm
    slope = np.empty_like(points)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = h
        ahead, behind = tissue.grid.distance(points + step), tissue.grid.distance(points - step)
        slope[:, axis] = ahead - behind
    size = np.linalg.norm(slope, axis=1)
    unit: FloatArray = slope / np.where(size > 0, size, np.inf)[:, None]
    return unit


def trunk_from(lines: TrunkLines, tree: int, root_radius_mm: float) -> Trunk:
    """Return one tree of the lines as a trunk: a segment for each node but the inlet."""
    mine = np.flatnonzero((lines.tree == tree) & (lines.parent >= 0))
    own = _chosen(lines, mine, lines.parent)
    parent = own.parent
    return Trunk(
        np.ascontiguousarray(lines.points[lines.parent[mine]]),
        np.ascontiguousarray(own.points),
        parent,
        children_of(parent),
        np.ones(len(mine)),
        root_radius_mm,
        0.0,
    )
