"""Move trunk vessels that came out wider than planned deeper below the tissue's surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.anatomy.trunk_lines import outward
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
    parent: IntArray,
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
