"""Smooth the trunk lines laid over a layer's points; convert them to trunks of trees to grow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.graph_trunk import LayerForest
from design.tissue import Tissue
from design.vasculature.growth.trunk import Trunk, straighten_line
from kernels.arrays import FloatArray, IntArray

ROUNDS = 40
"""Smoothing steps: bends of up to some six places are evened out, larger ones stay."""


@dataclass
class TrunkLines:
    """Trunks as trees of nodes, several in one, parents before their children.

    Attributes
    ----------
    points : (n, 3) float64, mm
    parent : (n,) int64
        -1 for an inlet.
    tree : (n,) int64
    share : (n,) float64
        Of the tissue's volume that lies nearest to a node or one downstream of it.
    """

    points: FloatArray
    parent: IntArray
    tree: IntArray
    share: FloatArray

    def main_child(self) -> IntArray:
        """The child of each node with the largest share; -1 at tips."""
        main = np.full(len(self.parent), -1, dtype=np.int64)
        # Last to be written is the largest; equal ones by number.
        for i in np.argsort(self.share, kind="stable"):
            if self.parent[i] >= 0:
                main[self.parent[i]] = i
        return main

    def child_count(self) -> IntArray:
        """How many children each node has."""
        below = self.parent[self.parent >= 0]
        return np.bincount(below, minlength=len(self.parent))


def lines_of(forest: LayerForest, ostia: dict[int, FloatArray], volume: FloatArray) -> TrunkLines:
    """The trees' nodes in order, parents first, each tree's ostium before its first place.

    A place of three children or more is parted into several along its main child's edge.

    Parameters
    ----------
    ostia : of each tree's number, (3,) float64, mm
        Where it enters.
    volume : (k, 3) float64, mm
        Points all over the tissue, by which shares are measured.
    """
    used = np.flatnonzero(forest.parent > -2)
    order = used[np.argsort(forest.way[used], kind="stable")]
    number = np.full(len(forest.parent), -1, dtype=np.int64)
    first = len(ostia)
    number[order] = first + np.arange(len(order))
    up, trees = forest.parent[order], forest.tree[order]
    enters = np.array([sorted(ostia).index(tree) for tree in trees.tolist()], dtype=np.int64)
    # Parents have shorter ways, so that they stand first.
    lines = TrunkLines(
        np.concatenate(
            [np.array([ostia[tree] for tree in sorted(ostia)]), forest.layer.points[order]]
        ),
        np.concatenate([np.full(first, -1), np.where(up >= 0, number[np.maximum(up, 0)], enters)]),
        np.concatenate([np.array(sorted(ostia)), trees]),
        np.zeros(first + len(order)),
    )
    return with_shares(_binary(with_shares(lines, volume)), volume)


def with_shares(lines: TrunkLines, volume: FloatArray) -> TrunkLines:
    """The lines with their shares of ``volume`` (k, 3) measured."""
    own = np.bincount(cKDTree(lines.points).query(volume)[1], minlength=len(lines.points))
    share = own.astype(np.float64)
    for i in range(len(share) - 1, -1, -1):
        if lines.parent[i] >= 0:
            share[lines.parent[i]] += share[i]
    return TrunkLines(lines.points, lines.parent, lines.tree, share / len(volume))


def _binary(lines: TrunkLines) -> TrunkLines:
    """Part places of three children or more: all but two move down the main child's edge."""
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
    """Lines of nodes in any order, put so that parents come before children; and their order."""
    depth = np.zeros(len(lines.parent), dtype=np.int64)
    above = lines.parent.copy()
    while (above >= 0).any():
        depth += above >= 0
        above = np.where(above >= 0, lines.parent[np.maximum(above, 0)], -1)
    order = np.argsort(depth, kind="stable")
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    up = lines.parent[order]
    parent = np.where(up >= 0, number[np.maximum(up, 0)], -1)
    return order, TrunkLines(lines.points[order], parent, lines.tree[order], lines.share[order])


def without(lines: TrunkLines, gone: NDArray[np.bool_]) -> TrunkLines:
    """The lines without some nodes; all below these must be among them."""
    number = np.cumsum(~gone) - 1
    kept = ~gone
    parent = np.where(lines.parent[kept] >= 0, number[lines.parent[kept]], -1)
    return TrunkLines(lines.points[kept], parent, lines.tree[kept], lines.share[kept])


def smooth_lines(
    tissue: Tissue,
    lines: TrunkLines,
    keep: Callable[[FloatArray], FloatArray],
    rounds: int = ROUNDS,
) -> TrunkLines:
    """Even out bends: each node moves halfway to the middle of its parent and main child.

    Parameters
    ----------
    keep : function of (n, 3) to (n, 3)
        Brings nodes back to where they must be: to the layer's depth, or into the tissue.
    """
    main = lines.main_child()
    inner = np.flatnonzero((lines.parent >= 0) & (main >= 0))
    points = lines.points.copy()
    for _ in range(rounds):
        middle = 0.5 * (points[lines.parent[inner]] + points[main[inner]])
        points[inner] += 0.5 * (middle - points[inner])
        points = keep(points)
    return TrunkLines(points, lines.parent, lines.tree, lines.share)


def thinned(lines: TrunkLines, tolerance_mm: FloatArray) -> TrunkLines:
    """The lines without nodes that lie within a tolerance (n,) of the straight beside them.

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
    while True:
        skip = (above >= 0) & ~kept[np.maximum(above, 0)]
        if not skip.any():
            break
        above[skip] = lines.parent[above[skip]]
    number = np.cumsum(kept) - 1
    parent = np.where(above[kept] >= 0, number[np.maximum(above[kept], 0)], -1)
    return TrunkLines(lines.points[kept], parent, lines.tree[kept], lines.share[kept])


def kept_at_depth(
    tissue: Tissue, depth_mm: FloatArray, fixed: NDArray[np.bool_], exactly: bool = True
) -> Callable[[FloatArray], FloatArray]:
    """Function that brings nodes (n, 3) to a depth (n,) below the surface, or at least there."""

    def keep(points: FloatArray) -> FloatArray:
        for _ in range(2):
            off = -tissue.grid.distance(points) - depth_mm
            off = np.where(fixed, 0.0, off if exactly else np.minimum(off, 0.0))
            points = points + off[:, None] * outward(tissue, points)
        return points

    return keep


def outward(tissue: Tissue, points: FloatArray) -> FloatArray:
    """Directions (n, 3) in which the signed distance rises, unit vectors; 0 where it is flat."""
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
    """One tree of the lines as a trunk: a segment for each node but the inlet."""
    mine = np.flatnonzero((lines.tree == tree) & (lines.parent >= 0))
    number = np.full(len(lines.parent), -1, dtype=np.int64)
    number[mine] = np.arange(len(mine))
    parent = number[lines.parent[mine]]
    children = np.full((len(mine), 2), -1, dtype=np.int64)
    for i, above in enumerate(parent.tolist()):
        if above >= 0:
            children[above, 0 if children[above, 0] < 0 else 1] = i
    return Trunk(
        np.ascontiguousarray(lines.points[lines.parent[mine]]),
        np.ascontiguousarray(lines.points[mine]),
        parent,
        children,
        np.ones(len(mine)),
        root_radius_mm,
        0.0,
    )
