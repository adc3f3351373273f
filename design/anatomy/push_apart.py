"""Move nodes of several vessel trees until vessels keep their clearance and lie in the tissue."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.anatomy.sink import moved_tree
from design.anatomy.trunk_lines import outward
from design.tissue import Tissue
from design.vasculature.collisions.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray

ROUNDS = 40
_MORE = 1.1
"""Clearance that is made, over that asked for."""

_SPREAD = 3
"""Pieces on either side over which a push is spread."""


def push_apart(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance_mm: float,
    clearance_ratio: float,
    room: float = 1.0,
) -> tuple[VesselTree, ...]:
    """The trees, their nodes moved until vessels are clear of each other, or as far as it goes.

    Of two that are too near each gives way, the thinner one more; neighbours along a vessel
    follow. Inlets stay.

    Parameters
    ----------
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`.
    room : float
        Clearance at which pushing ends, over that asked for; below `_MORE`, which is aimed at.
    """
    trees = tuple(trees)
    for _ in range(ROUNDS):
        shift, worst = _pushes(trees, clearance_mm, clearance_ratio, room)
        back = _back(tissue, trees, room * clearance_mm)
        if worst <= 0.0 and not back.any():
            break
        shift += back
        first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
        trees = tuple(
            moved_tree(tree, tree.distal + _spread(tree, shift[a:b]))
            for tree, a, b in zip(trees, first[:-1], first[1:], strict=True)
        )
    return trees


def _pushes(
    trees: Sequence[VesselTree], mm: float, ratio: float, room: float
) -> tuple[FloatArray, float]:
    """How far the end of each segment, numbered on, is to move for what is near, (n, 3), mm.

    And how much the nearest pair lacks, mm; at most 0 where all are clear.
    """
    first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
    begin = np.concatenate([tree.proximal for tree in trees])
    end = np.concatenate([tree.distal for tree in trees])
    radius = np.concatenate([tree_radii(tree) for tree in trees])
    above = np.concatenate(
        [np.where(t.parent >= 0, t.parent + a, -1) for t, a in zip(trees, first[:-1], strict=True)]
    )
    shift, pushed = np.zeros_like(end), np.zeros(len(end))
    near = collisions(forest_to_network(trees), mm, ratio, _MORE, room**-0.5)
    if not near.count:
        return shift, 0.0
    one, two = near.pieces.T
    need = np.maximum(mm, ratio * np.minimum(radius[one], radius[two]))
    lack = _MORE * need - near.gap_mm
    for mine, other in ((one, two), (two, one)):
        way = end[mine] - begin[mine]
        along = np.einsum("ij,ij->i", near.place_mm - begin[mine], way)
        part = np.clip(along / np.einsum("ij,ij->i", way, way), 0.0, 1.0)
        off = begin[mine] + part[:, None] * way - near.place_mm
        off /= np.maximum(np.linalg.norm(off, axis=1), 1e-12)[:, None]
        far = lack * radius[other] / (radius[mine] + radius[other])
        far = np.minimum(far, 0.5 * radius[mine])
        for node, weight in ((mine, part), (above[mine], 1.0 - part)):
            there = node >= 0
            np.add.at(shift, node[there], (far * weight)[there, None] * off[there])
            np.add.at(pushed, node[there], weight[there])
    return shift / np.maximum(pushed, 1.0)[:, None], float((room * need - near.gap_mm).max())


def _back(tissue: Tissue, trees: Sequence[VesselTree], mm: float) -> FloatArray:
    """How far the end of each segment, numbered on, is to move into the tissue, (n, 3), mm."""
    shifts = []
    for tree in trees:
        need = tree_radii(tree) + mm
        inside = tissue.grid.capsule_inside(tree.proximal, tree.distal, need)
        out = np.flatnonzero(~inside & (tree.parent >= 0))
        wanted = np.zeros(len(need))
        for nodes in (out, tree.parent[out]):
            np.maximum.at(wanted, nodes, need[out])
        nodes = np.flatnonzero(wanted)
        lack = wanted[nodes] + tissue.grid.distance(tree.distal[nodes])
        far = np.maximum(lack, 0.03 * wanted[nodes])
        shift = np.zeros_like(tree.distal)
        shift[nodes] = -_MORE * far[:, None] * outward(tissue, tree.distal[nodes])
        shifts.append(shift)
    return np.concatenate(shifts)


def _spread(tree: VesselTree, shift: FloatArray) -> FloatArray:
    """Pushes (n, 3) of a tree's nodes spread over their neighbours; what is pushed goes as far."""
    up = np.flatnonzero(tree.parent >= 0)
    size = np.linalg.norm(shift, axis=1)
    spread = shift
    for _ in range(_SPREAD):
        total, count = spread.copy(), np.ones(len(shift))
        np.add.at(total, up, spread[tree.parent[up]])
        np.add.at(total, tree.parent[up], spread[up])
        np.add.at(count, up, 1.0)
        np.add.at(count, tree.parent[up], 1.0)
        spread = np.where(size[:, None] > 0.0, shift, total / count[:, None])
    return spread
