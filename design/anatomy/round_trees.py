"""Curve several trees, as far as they then stay clear of each other and in the tissue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.anatomy.curves import Lines, curve_tree, turns
from design.tissue import Tissue
from design.vasculature.collisions.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii

FloatArray = NDArray[np.float64]

ROUNDS = 12
_LESS = 0.5
_LEAST = 0.02


@dataclass(frozen=True)
class CurvedTrees:
    """Trees with curves, and what they cost.

    Attributes
    ----------
    trees : tuple of VesselTree
    pieces_near : int
        Pairs of pieces that are still nearer than the clearance.
    pieces_out : int
        Pieces that reach out of the tissue, but those at the inlets.
    """

    trees: tuple[VesselTree, ...]
    pieces_near: int
    pieces_out: int


def curve_trees(
    tissue: Tissue, trees: Sequence[VesselTree], clearance_mm: float, clearance_ratio: float
) -> CurvedTrees:
    """Round all bends and main lines; where something is in the way, less.

    Each curve reaches as far as its vessels allow; those of pieces that come too near to others,
    or out of the tissue, are halved until all fit.
    """
    reach = [np.ones(len(tree.parent)) for tree in trees]
    for _ in range(ROUNDS):
        curved = [curve_tree(tree, some) for tree, some in zip(trees, reach, strict=True)]
        done = tuple(tree for tree, _ in curved)
        near, out = misfits(tissue, done, clearance_mm, clearance_ratio)
        if not near and not out.any():
            break
        first = np.cumsum([0, *(len(tree.parent) for tree in done)])
        bad = np.zeros(first[-1], dtype=np.bool_)
        bad[out] = True
        bad[[piece for pair in near for piece in pair]] = True
        for n, (tree, (_, lines)) in enumerate(zip(trees, curved, strict=True)):
            _lower(tree, lines, bad[first[n] : first[n + 1]], reach[n])
    return CurvedTrees(done, len(near), int(out.sum()) if out.dtype == bool else len(out))


def misfits(
    tissue: Tissue, trees: Sequence[VesselTree], clearance_mm: float, clearance_ratio: float
) -> tuple[list[list[int]], NDArray[np.int64]]:
    """Pairs of segments nearer than the clearance, and segments that reach out of the tissue.

    Segments of all trees are numbered on. A root's segment may begin outside.
    """
    found = collisions(forest_to_network(trees), clearance_mm, clearance_ratio)
    start = np.concatenate([tree.proximal for tree in trees])
    end = np.concatenate([tree.distal for tree in trees])
    radius = np.concatenate([tree_radii(tree) for tree in trees])
    parent = np.concatenate([tree.parent for tree in trees])
    inside = tissue.grid.capsule_inside(start, end, radius, clearance_mm)
    return found.vessels.tolist(), np.flatnonzero(~inside & (parent >= 0))


def _lower(tree: VesselTree, lines: Lines, bad: NDArray[np.bool_], reach: FloatArray) -> None:
    """Lower the reach of the curves that bad pieces belong to, or lie between."""
    pieces = np.flatnonzero(bad) + 1
    segment = lines.origin[pieces]
    corners = np.concatenate([lines.corner[pieces], segment, tree.parent[segment]])
    corners = np.unique(corners[corners >= 0])
    reach[corners] = np.where(reach[corners] > _LEAST, _LESS * reach[corners], 0.0)


def kinks(trees: Sequence[VesselTree], degrees: float, of_root: float) -> int:
    """Turns of main lines above an angle, in vessels wider than a part of their root's radius."""
    count = 0
    for tree in trees:
        upper, turn = turns(tree)
        wide = tree_radii(tree) > of_root * float(tree_radii(tree)[0])
        count += int(((turn > np.radians(degrees)) & wide[upper]).sum())
    return count
