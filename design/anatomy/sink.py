"""Move trunk vessels that came out wider than planned deeper below the tissue's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.anatomy.trunk_lines import outward
from design.errors import WideTrunkError
from design.tissue import Tissue
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_from_topology, tree_radii
from kernels.arrays import BoolArray, FloatArray, IntArray

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
    return _derived(
        tree,
        np.concatenate([tree.proximal, middle]),
        distal,
        parent,
        children,
        tree.relative_flow[more],
        tree.given[more],
    )


def moved_tree(tree: VesselTree, distal: FloatArray) -> VesselTree:
    """The same tree with other far ends (n, 3), its radii derived anew."""
    proximal = np.where(
        (tree.parent >= 0)[:, None], distal[np.maximum(tree.parent, 0)], tree.proximal
    )
    return _derived(
        tree, proximal, distal, tree.parent, tree.children, tree.relative_flow, tree.given
    )


def _derived(
    tree: VesselTree,
    proximal: FloatArray,
    distal: FloatArray,
    parent: NDArray[np.int32],
    children: NDArray[np.int32],
    relative_flow: FloatArray,
    given: BoolArray,
) -> VesselTree:
    """A tree of these segments with another's flow, pressure drop and blood."""
    derived = tree_from_topology(
        proximal,
        distal,
        parent,
        children,
        flow_ul_s=float(tree.flow_ul_s[0]),
        pressure_drop_pa=tree.pressure_drop_pa,
        murray_exponent=tree.murray_exponent,
        viscosity_pa_s=tree.viscosity_pa_s,
        relative_flow=relative_flow,
        haematocrit=tree.haematocrit,
        given=given,
    )
    return replace(derived, notes=tree.notes)


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
