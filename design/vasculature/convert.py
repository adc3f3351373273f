"""Convert a grown vessel tree to a network of straight vessels with radii."""

from __future__ import annotations

import numpy as np

from design.network import VesselKind, VesselNetwork
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii


def tree_to_network(
    tree: VesselTree, kind: VesselKind = VesselKind.ARTERY, tree_number: int = 0
) -> VesselNetwork:
    """One straight vessel of constant radius for each segment, flow from root to terminals.

    Node 0 is the root's inlet; node i + 1 the far end of segment i.
    """
    count = len(tree.parent)
    nodes = np.concatenate([tree.proximal[:1], tree.distal])
    # The root's parent is -1, so it begins at node 0.
    ends = np.column_stack([tree.parent.astype(np.int64) + 1, np.arange(1, count + 1)])
    return VesselNetwork.from_segments(
        nodes,
        ends,
        tree_radii(tree),
        np.full(count, int(kind), dtype=np.int64),
        np.full(count, tree_number, dtype=np.int64),
    )
