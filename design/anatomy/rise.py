"""Move trunk vessels nearer to the tissue's surface where they lie deeper than their radii need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from design.anatomy.sink import moved_tree
from design.anatomy.trunk_lines import outward
from design.tissue import Tissue
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray, IntArray

Trees = tuple[VesselTree, ...]

_ROOM = 1.012
"""Radii that are kept below the surface, over those that the tree has."""

_ROUNDS, _LAST = 14, 6
_LESS = 0.75
"""What is left of a rise near a misfit, each round; in the last rounds nothing."""

_AROUND = 2
"""Nodes on either side of a misfit that rise less; twice as many in each of the last rounds."""


def risen_trees(
    tissue: Tissue,
    trees: Trees,
    clearance_mm: float,
    shallow_mm: float,
    misfits: Callable[[Trees], IntArray],
) -> Trees:
    """The trees with their trunks as shallow as their radii allow, where nothing is in the way.

    Trunks are laid for radii with a margin, and chords and curves draw them inwards: what is left
    of that is taken back here. Nodes near what doesn't fit then rise less, and at last not at all.

    Parameters
    ----------
    shallow_mm : float
        Least depth of the axes.
    misfits : function of trees to segments (k,)
        Those, numbered on, that don't fit.
    """
    shift = [rise(tissue, tree, clearance_mm, shallow_mm) for tree in trees]
    first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
    for left in range(_ROUNDS - 1, -1, -1):
        moved = tuple(
            moved_tree(tree, tree.distal + way) for tree, way in zip(trees, shift, strict=True)
        )
        bad = misfits(moved)
        if not len(bad):
            return moved
        for n, tree in enumerate(trees):
            mine = bad[(bad >= first[n]) & (bad < first[n + 1])] - first[n]
            far = _AROUND * 2 ** max(0, _LAST - left)
            shift[n][_around(tree, mine, far)] *= _LESS if left >= _LAST else 0.0
    return trees


def rise(tissue: Tissue, tree: VesselTree, clearance_mm: float, shallow_mm: float) -> FloatArray:
    """How far the end of each segment of the trunk may rise, (n, 3), mm; 0 for all others."""
    radius = tree_radii(tree)
    own = np.flatnonzero(tree.given & (tree.parent >= 0))
    need = np.full(len(tree.parent), shallow_mm)
    for nodes in (own, tree.parent[own]):
        np.maximum.at(need, nodes, _ROOM * radius[own] + clearance_mm)
    points = tree.distal[own]
    deeper = -tissue.grid.distance(points) - need[own]
    shift = np.zeros_like(tree.distal)
    shift[own] = np.clip(deeper, 0.0, need.max())[:, None] * outward(tissue, points)
    return shift


def _around(tree: VesselTree, segments: IntArray, far: int) -> NDArray[np.bool_]:
    """Which segments are ``far`` nodes from any of ``segments`` at most."""
    near = np.zeros(len(tree.parent), dtype=np.bool_)
    near[segments] = True
    up = np.flatnonzero(tree.parent >= 0)
    for _ in range(far):
        more = near.copy()
        more[up] |= near[tree.parent[up]]
        np.logical_or.at(more, tree.parent[up], near[up])
        near = more
    return near
