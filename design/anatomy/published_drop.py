"""Convert grown trees to a network; match a heart's radii to published ones by pressure drops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.grown import Trees, grow_fitted
from design.anatomy.main_branches import MainBranch, lost_branch, missing_branches, trunk_pieces
from design.errors import GrowthError
from design.measures.published_comparison import PublishedMatch, published_match
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.forest import joined_networks
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import FloatArray

_DROPS: Final = 3
"""Other pressure drops that are tried at most."""
LAID: Final = 0.85
"""Of the planned trunks' length, below which it is told: smoothed they are a twentieth shorter. Of
the length with the given pressure drop, which another drop must keep."""
_REACH: Final = 1.15
"""Distance from the nearest terminal, of 99 % of the tissue, with another pressure drop over that
with the given one, at most: no part may lose its supply for nearer radii."""


def with_published_radii(
    trees: Trees,
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    branches: tuple[MainBranch, ...],
    volume: FloatArray,
) -> Trees:
    """Trees as they are where their radii are the published ones, else grown with another drop.

    Trees that don't fit then, lack trunks, a main branch or supply of some places of ``volume``, or
    are farther from the table aren't taken; half of the change is tried then. There are some
    already, so that vessels that find no room aren't tried again from other random numbers.
    """
    once, least = replace(plan, tries=1), LAID * trunks_mm(trees)
    most_mm = _REACH * _reach_mm(volume, trees)
    match = _published_match(trees)
    factor = match.factor
    for _ in range(_DROPS):
        if factor == 1.0:
            break
        drop = trees[0].pressure_drop_pa / factor**4
        other = _grown_with(tissue, once, replace(options, pressure_drop_pa=drop))
        found = match if other is None else _published_match(other)
        # Wider trunks that cost many branches aren't worth nearer figures.
        if (
            other is None
            or lost_branch(branches, trunk_pieces(other)) is not None
            or trunks_mm(other) <= least
            or _reach_mm(volume, other) > most_mm
            or found.farthest_sd >= match.farthest_sd
            or _missing(branches, other) > _missing(branches, trees)
        ):
            factor = factor**0.5
        else:
            trees, match, factor = other, found, found.factor
    return trees


def _reach_mm(volume: FloatArray, trees: Trees) -> float:
    """Way, mm, from the nearest terminal within which 99 % of places (n, 3) lie."""
    ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
    return float(np.percentile(cKDTree(ends).query(volume)[0], 99.0))


def _missing(branches: tuple[MainBranch, ...], trees: Trees) -> int:
    return len(missing_branches(branches, trunk_pieces(trees)))


def _grown_with(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees | None:
    """Trees, or None where they don't fit."""
    try:
        return grow_fitted(tissue, plan, options)
    except GrowthError:
        return None


def _published_match(trees: Sequence[VesselTree]) -> PublishedMatch:
    kinds = (VesselKind.ARTERY,) * len(trees)
    return published_match(curved_network(trees, kinds), "coronary")


def trunks_mm(trees: Trees) -> float:
    """Length of all trunks, mm."""
    pieces = np.concatenate([(tree.distal - tree.proximal)[tree.given] for tree in trees])
    return float(np.linalg.norm(pieces, axis=1).sum())


# Convert an organ's grown trees to a network of curved vessels from junction to junction.


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
