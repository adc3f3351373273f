"""Move trunk vessels nearer to the tissue's surface where they lie deeper than their radii need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.anatomy.sink import moved_tree
from design.anatomy.trunk_lines import outward
from design.tissue import Tissue
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import FloatArray, IntArray

Trees = tuple[VesselTree, ...]

_ROOM = 1.012
"""Radii that are kept below the surface, over those that the tree has."""

_STEEP = 0.1
"""Change of the rise along a vessel, over the way: what is straight turns by 6 degrees at most."""

_ROUNDS, _LAST = 14, 6
_LESS = 0.75
"""What is left of a rise at a misfit, each round; in the last rounds nothing."""


def risen_trees(
    tissue: Tissue,
    trees: Trees,
    clearance_mm: float,
    shallow_mm: float,
    misfits: Callable[[Trees], IntArray],
) -> Trees:
    """The trees with their trunks as shallow as their radii allow, where nothing is in the way.

    Trunks are laid for radii with a margin, and chords and curves draw them inwards: what is left
    of that is taken back here. Branches come with the trunk where they leave it, less and less
    along their way. Nodes at what doesn't fit then rise less, and at last not at all.

    Parameters
    ----------
    shallow_mm : float
        Least depth of the axes.
    misfits : function of trees to segments (k,)
        Those, numbered on, that don't fit.
    """
    rises = [_Rise.of(tissue, tree, clearance_mm, shallow_mm) for tree in trees]
    first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
    for left in range(_ROUNDS - 1, -1, -1):
        moved = tuple(rise.risen() for rise in rises)
        bad = misfits(moved)
        if not len(bad):
            return moved
        for n, rise in enumerate(rises):
            mine = bad[(bad >= first[n]) & (bad < first[n + 1])] - first[n]
            rise.lower(mine, _LESS if left >= _LAST else 0.0, 2 ** max(0, _LAST - left))
    return trees


@dataclass
class _Rise:
    """How far the end of each segment of a tree rises.

    Attributes
    ----------
    tree : VesselTree
    height : (n,) float64, mm
        Of a trunk's nodes; 0 for all others.
    way : (n, 3) float64
        Unit vectors.
    trunk : tuple of int
        Segments of the trunk but roots, parents before children.
    """

    tree: VesselTree
    height: FloatArray
    way: FloatArray
    trunk: tuple[int, ...]

    @staticmethod
    def of(tissue: Tissue, tree: VesselTree, clearance_mm: float, shallow_mm: float) -> _Rise:
        """As far as the radii at each node of the trunk allow."""
        radius = tree_radii(tree)
        own = np.flatnonzero(tree.given & (tree.parent >= 0))
        need = np.full(len(tree.parent), shallow_mm)
        for nodes in (own, tree.parent[own]):
            np.maximum.at(need, nodes, _ROOM * radius[own] + clearance_mm)
        height, way = np.zeros(len(tree.parent)), np.zeros_like(tree.distal)
        deeper = -tissue.grid.distance(tree.distal[own]) - need[own]
        height[own] = np.clip(deeper, 0.0, need.max())
        way[own] = outward(tissue, tree.distal[own])
        order = downward_order(tree.children)
        trunk = order[tree.given[order] & (tree.parent[order] >= 0)]
        return _Rise(tree, height, way, tuple(trunk.tolist()))

    def risen(self) -> VesselTree:
        """The tree, risen."""
        tree = self.tree
        change = _STEEP * np.linalg.norm(tree.distal - tree.proximal, axis=1)
        self._slope(change)
        height, shift = self.height.copy(), self.height[:, None] * self.way
        higher = np.flatnonzero(height > 0).tolist()
        while higher:
            up = higher.pop()
            for i in tree.children[up].tolist():
                if i >= 0 and not tree.given[i] and height[up] > change[i]:
                    height[i] = height[up] - change[i]
                    shift[i] = (height[i] / height[up]) * shift[up]
                    higher.append(i)
        return moved_tree(tree, tree.distal + shift)

    def _slope(self, change: FloatArray) -> None:
        """Lower heights until along each segment of the trunk they differ by ``change`` at most."""
        parent, height = self.tree.parent, self.height
        for i in reversed(self.trunk):
            height[parent[i]] = min(height[parent[i]], height[i] + change[i])
        for i in self.trunk:
            height[i] = min(height[i], height[parent[i]] + change[i])

    def lower(self, segments: IntArray, part: float, far: int) -> None:
        """Leave a part of the rise of the nodes that are ``far`` from any of ``segments`` at most.

        A branch's segment lowers the trunk that it leaves.
        """
        tree = self.tree
        near = np.zeros(len(tree.parent), dtype=np.bool_)
        top = segments.copy()
        while (branch := ~tree.given[top] & (tree.parent[top] >= 0)).any():
            top[branch] = tree.parent[top[branch]]
        near[top] = True
        self.height[_around(tree, near, far)] *= part


def _around(tree: VesselTree, near: NDArray[np.bool_], far: int) -> NDArray[np.bool_]:
    """What is ``far`` nodes from any that is near at most."""
    up = np.flatnonzero(tree.parent >= 0)
    for _ in range(far):
        more = near.copy()
        more[up] |= near[tree.parent[up]]
        np.logical_or.at(more, tree.parent[up], near[up])
        near = more
    return near
