"""Move trunk vessels that came out wider than planned deeper below the tissue's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from design.anatomy.trunk_lines import outward
from design.errors import WideTrunkError
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_from_topology, tree_radii
from kernels.arrays import FloatArray, IntArray

ROUNDS = 8
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
    factor = _MARGIN * narrower**-4
    drop = factor * trees[0].pressure_drop_pa / PA_PER_MMHG
    x, y, z = end[worst]
    raise WideTrunkError(
        f"a trunk {2 * radius[worst]:.3g} mm wide, which feeds {fed[worst]} of {total} terminals, "
        f"doesn't fit in the wall near ({x:.4g}, {y:.4g}, {z:.4g}) mm: beside clearance_mm there's "
        f"room for {2 * max(float(deep[worst]), 0.0):.3g} mm; give a pressure_drop_mmhg of "
        f"{drop:.2g} or more (radii fall by its fourth root), where smallest_diameter_mm is given "
        "a smaller one, or inlets where the wall is thicker",
        factor,
    )
