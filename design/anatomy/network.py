"""Convert an organ's grown trees to a network of curved vessels from junction to junction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.network import VesselKind, VesselNetwork
from design.vasculature.growth.forest import joined_networks
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import FloatArray


def curved_network(trees: Sequence[VesselTree], kinds: Sequence[VesselKind]) -> VesselNetwork:
    """All trees as one network; a vessel reaches from joint to joint, through all its bends.

    Veins and lymph flow from terminals to root.
    """
    return joined_networks(
        [_of_tree(*each, number) for number, each in enumerate(zip(trees, kinds, strict=True))]
    )


def _of_tree(tree: VesselTree, kind: VesselKind, number: int) -> VesselNetwork:
    bend = (tree.children[:, 0] >= 0) & (tree.children[:, 1] < 0)
    radius = tree_radii(tree)
    node_of = np.full(len(tree.parent), -1, dtype=np.int64)
    nodes, ends, lines, radii = [tree.proximal[0]], [], [], []
    open_runs: dict[int, tuple[int, list[FloatArray], list[float]]] = {}
    for s in downward_order(tree.children).tolist():
        above = int(tree.parent[s])
        if above >= 0 and bend[above]:
            run = open_runs.pop(above)
        else:
            begin = 0 if above < 0 else int(node_of[above])
            run = (begin, [nodes[begin]], [])
        run[1].append(tree.distal[s])
        run[2].append(radius[s])
        if bend[s]:
            open_runs[s] = run
            continue
        nodes.append(tree.distal[s])
        node_of[s] = len(nodes) - 1
        ends.append((run[0], len(nodes) - 1))
        lines.append(np.array(run[1]))
        # One radius from joint to joint, to the last digit.
        radii.append(np.full(len(run[1]), run[2][0]))
    drains = kind in (VesselKind.VEIN, VesselKind.LYMPH)
    if drains:
        ends = [(end, begin) for begin, end in ends]
        lines = [line[::-1] for line in lines]
    count = len(ends)
    return VesselNetwork(
        np.array(nodes),
        np.array(ends, dtype=np.int64),
        np.full(count, int(kind), dtype=np.int64),
        np.full(count, number, dtype=np.int64),
        np.concatenate([[0], np.cumsum([len(line) for line in lines])]).astype(np.int64),
        np.concatenate(lines),
        np.concatenate(radii),
    )
