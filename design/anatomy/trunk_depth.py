"""Move trunk vessels nearer to the tissue's surface, or deeper, as their radii need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.anatomy.curves import derived_tree
from design.anatomy.trunk_lines import outward
from design.errors import WideTrunkError
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


# Move trunk vessels that came out wider than planned deeper below the tissue's surface.

ROUNDS = 8
_SHORT = 2.0
"""Of the room that a piece needs about its axis: a longer one is bent where its ends are deep
enough."""
_A_LITTLE = 1.02
_WIDER = 1.01
"""Radii that are made room for, over those that the tree has: curves change them a little."""
_MANY = 0.3
"""Of all terminals: more than can be grown to spare elsewhere (`grown.py`)."""
_MARGIN = 1.1
"""Pressure drop that is advised, over that which is just enough."""
_ACROSS = 11
"""Places across a wall where its depth is looked up."""


def sink_trunk(tissue: Tissue, tree: VesselTree, clearance_mm: float) -> VesselTree:
    """The tree with each node of its trunk as deep as the widest vessel there asks for.

    A long piece gets a bend in its middle, which may be shallow where its ends are not. Branches
    keep their other end. Radii are derived anew.
    """
    for _ in range(ROUNDS):
        tree, out, wide = _bent(tissue, tree, clearance_mm)
        if not len(out):
            return tree
        # A node is named by the segment that ends there.
        need = np.zeros(len(tree.parent))
        nodes = np.concatenate([out, tree.parent[out]])
        np.maximum.at(need, nodes, np.tile(wide[out], 2))
        nodes = np.unique(nodes)
        points = tree.distal[nodes]
        short = np.maximum(need[nodes] + tissue.grid.distance(points), 0.02 * need[nodes])
        moved = tree.distal.copy()
        moved[nodes] -= (_A_LITTLE * short)[:, None] * outward(tissue, points)
        tree = moved_tree(tree, moved)
    return tree


def _bent(
    tissue: Tissue, tree: VesselTree, clearance_mm: float
) -> tuple[VesselTree, IntArray, FloatArray]:
    """The tree, long trunk pieces that reach out bent; which ones do; room that each needs, mm."""
    while True:
        own = np.flatnonzero(tree.given & (tree.parent >= 0))
        wide = _WIDER * tree_radii(tree) + clearance_mm
        inside = tissue.grid.capsule_inside(tree.proximal[own], tree.distal[own], wide[own])
        out = own[~inside]
        length = np.linalg.norm(tree.distal[out] - tree.proximal[out], axis=1)
        long = out[length > _SHORT * wide[out]]
        if not len(long):
            return tree, out, wide
        tree = with_bends(tree, long)


def with_bends(tree: VesselTree, segments: IntArray) -> VesselTree:
    """The same tree with each of ``segments`` (k,) in two halves, the lower ones numbered last."""
    lower = np.arange(len(tree.parent), len(tree.parent) + len(segments))
    middle = 0.5 * (tree.proximal[segments] + tree.distal[segments])
    distal = np.concatenate([tree.distal, tree.distal[segments]])
    distal[segments] = middle
    children = np.concatenate([tree.children, tree.children[segments]])
    children[segments] = np.column_stack([lower, np.full(len(lower), -1)])
    parent = np.concatenate([tree.parent, segments]).astype(tree.parent.dtype)
    for column in children[lower].T:
        parent[column[column >= 0]] = lower[column >= 0]
    more = np.concatenate([np.arange(len(tree.parent)), segments])
    begins = np.concatenate([tree.proximal, middle])
    return derived_tree(tree, begins, distal, parent, children, more)


def moved_tree(tree: VesselTree, distal: FloatArray) -> VesselTree:
    """The same tree with other far ends (n, 3), its radii derived anew."""
    proximal = np.where(
        (tree.parent >= 0)[:, None], distal[np.maximum(tree.parent, 0)], tree.proximal
    )
    return derived_tree(tree, proximal, distal, tree.parent, tree.children)


def check_trunks(
    tissue: Tissue, trees: Sequence[VesselTree], out: IntArray, clearance_mm: float
) -> None:
    """Raise if trunk pieces, numbered on, that reach ``out`` of the tissue feed too many terminals.

    Such a piece is too wide for the wall, wherever it is moved.

    Raises
    ------
    WideTrunkError
    """
    fed = np.concatenate([tree.terminals for tree in trees])[out]
    total = sum(int(tree.terminals[0]) for tree in trees)
    out, fed = out[fed > _MANY * total], fed[fed > _MANY * total]
    if not len(out):
        return
    end = np.concatenate([tree.distal for tree in trees])[out]
    radius = _WIDER * np.concatenate([tree_radii(tree) for tree in trees])[out]
    # What was sunk may lie beyond the middle of the wall.
    across = np.linspace(-0.5, 0.5, _ACROSS)[:, None, None] * radius[:, None] * outward(tissue, end)
    far = tissue.grid.distance((end + across).reshape(-1, 3)).reshape(_ACROSS, -1)
    deep = -far.min(axis=0) - clearance_mm
    part = deep / radius
    worst = int(np.argmin(part))
    # A piece's end may have room where its middle hasn't.
    narrower = min(1.0 / _WIDER, max(float(part[worst]), 0.1))
    x, y, z = end[worst]
    raise WideTrunkError(
        f"a trunk {2 * radius[worst]:.3g} mm wide, which feeds {fed[worst]} of {total} terminals, "
        f"doesn't fit in the wall near ({x:.4g}, {y:.4g}, {z:.4g}) mm: beside clearance_mm there's "
        f"room for {2 * max(float(deep[worst]), 0.0):.3g} mm",
        drop_factor=_MARGIN * narrower**-4,
    )
