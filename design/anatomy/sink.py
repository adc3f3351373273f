"""Move trunk vessels that came out wider than planned deeper below the tissue's surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from design.anatomy.trunk_lines import outward
from design.tissue import Tissue
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_from_topology, tree_radii
from kernels.arrays import FloatArray

ROUNDS = 8
_A_LITTLE = 1.02
_WIDER = 1.01
"""Radii that are made room for, over those that the tree has: curves change them a little."""


def sink_trunk(tissue: Tissue, tree: VesselTree, clearance_mm: float) -> VesselTree:
    """The tree with each node of its trunk as deep as the widest vessel there asks for.

    Branches keep their other end. Radii are derived anew.
    """
    for _ in range(ROUNDS):
        radius = tree_radii(tree)
        own = np.flatnonzero(tree.given & (tree.parent >= 0))
        wide = _WIDER * radius + clearance_mm
        inside = tissue.grid.capsule_inside(tree.proximal[own], tree.distal[own], wide[own])
        out = own[~inside]
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


def moved_tree(tree: VesselTree, distal: FloatArray) -> VesselTree:
    """The same tree with other far ends (n, 3), its radii derived anew."""
    proximal = np.where(
        (tree.parent >= 0)[:, None], distal[np.maximum(tree.parent, 0)], tree.proximal
    )
    moved = tree_from_topology(
        proximal,
        distal,
        tree.parent,
        tree.children,
        flow_ul_s=float(tree.flow_ul_s[0]),
        pressure_drop_pa=tree.pressure_drop_pa,
        murray_exponent=tree.murray_exponent,
        viscosity_pa_s=tree.viscosity_pa_s,
        relative_flow=tree.relative_flow,
        haematocrit=tree.haematocrit,
        given=tree.given,
    )
    return replace(moved, notes=tree.notes)
