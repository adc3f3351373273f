"""Move nodes until vessels keep their clearance and lie in the tissue."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.anatomy.curves import derived_tree
from design.anatomy.fitting.goal import FIT, Clearance, Segments, Trees, reaching_out
from design.anatomy.trunk_lines import outward
from design.network import VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from kernels.arrays import FloatArray, IntArray


def push_apart(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance: Clearance,
    shallow_mm: float | None = None,
) -> Trees:
    """Move nodes until vessels are clear of each other and in the tissue, or as far as it goes.

    Of two that are too near each gives way, the thinner one more; neighbours along a vessel
    follow. Inlets stay. At first trunks rise to the depth that their radii need, or
    ``shallow_mm`` where it is given.
    """
    trees = tuple(trees)
    for n in range(FIT.pushes):
        every = Segments.of(trees)
        shift, worst = _pushes(forest_to_network(trees), every, clearance)
        back = _back(tissue, every, clearance.room * clearance.mm)
        shift += back
        if shallow_mm is not None and n < FIT.rises:
            shift += _rise(tissue, every, clearance, shallow_mm)
        elif worst <= 0.0 and not back.any():
            break
        end = every.end + _spread(every.parent, shift)
        trees = tuple(
            moved_tree(tree, end[a:b])
            for tree, a, b in zip(trees, every.first[:-1], every.first[1:], strict=True)
        )
    return trees


def moved_tree(tree: VesselTree, distal: FloatArray) -> VesselTree:
    """Return the same tree with other far ends (n, 3), its radii derived anew."""
    inner = (tree.parent >= 0)[:, None]
    proximal = np.where(inner, distal[np.maximum(tree.parent, 0)], tree.proximal)
    return derived_tree(tree, proximal, distal, tree.parent, tree.children)


def _pushes(
    network: VesselNetwork, every: Segments, clearance: Clearance
) -> tuple[FloatArray, float]:
    """Return how far the end of each segment is to move for what is near, (n, 3), mm.

    And how much the nearest pair lacks, mm; at most 0 where all are clear.
    """
    mm, ratio, room = clearance
    begin, end, radius = every.begin, every.end, every.radius
    shift, pushed = np.zeros_like(end), np.zeros(len(end))
    near = collisions(network, mm, ratio, FIT.more, room**-0.5)
    if not near.count:
        return shift, 0.0
    one, two = near.pieces.T
    need = np.maximum(mm, ratio * np.minimum(radius[one], radius[two]))
    lack = FIT.more * need - near.gap_mm
    for mine, other in ((one, two), (two, one)):
        way = end[mine] - begin[mine]
        along = np.einsum("ij,ij->i", near.place_mm - begin[mine], way)
        part = np.clip(along / np.einsum("ij,ij->i", way, way), 0.0, 1.0)
        off = begin[mine] + part[:, None] * way - near.place_mm
        off /= np.maximum(np.linalg.norm(off, axis=1), 1e-12)[:, None]
        far = lack * radius[other] / (radius[mine] + radius[other])
        far = np.minimum(far, 0.5 * radius[mine])
        for node, weight in ((mine, part), (every.parent[mine], 1.0 - part)):
            there = node >= 0
            np.add.at(shift, node[there], (far * weight)[there, None] * off[there])
            np.add.at(pushed, node[there], weight[there])
    return shift / np.maximum(pushed, 1.0)[:, None], float((room * need - near.gap_mm).max())


def _back(tissue: Tissue, every: Segments, mm: float) -> FloatArray:
    """Return how far the end of each segment is to move into the tissue, (n, 3), mm."""
    out = reaching_out(tissue, every, mm)
    wanted, shift = np.zeros(len(every.radius)), np.zeros_like(every.end)
    for nodes in (out, every.parent[out]):
        np.maximum.at(wanted, nodes, every.radius[out] + mm)
    nodes = np.flatnonzero(wanted)
    lack = wanted[nodes] + tissue.grid.distance(every.end[nodes])
    far = np.maximum(lack, 0.03 * wanted[nodes])
    shift[nodes] = -FIT.more * far[:, None] * outward(tissue, every.end[nodes])
    return shift


def _rise(tissue: Tissue, every: Segments, clearance: Clearance, shallow_mm: float) -> FloatArray:
    """Return how far ends (n, 3), mm, of trunks that lie too deep are to rise."""
    nodes = np.flatnonzero(every.given & (every.parent >= 0))
    room = FIT.wider * every.radius[nodes] + clearance.room * clearance.mm
    deeper = -tissue.grid.distance(every.end[nodes]) - np.maximum(room, shallow_mm)
    shift = np.zeros_like(every.end)
    shift[nodes] = np.maximum(deeper, 0.0)[:, None] * outward(tissue, every.end[nodes])
    return shift


def _spread(parent: IntArray, shift: FloatArray) -> FloatArray:
    """Return pushes (n, 3) of nodes spread over their neighbours; what is pushed goes as far."""
    up = np.flatnonzero(parent >= 0)
    pushed = np.linalg.norm(shift, axis=1)[:, None] > 0.0
    spread = shift
    for _ in range(FIT.neighbours):
        total, count = spread.copy(), np.ones(len(shift))
        np.add.at(total, up, spread[parent[up]])
        np.add.at(total, parent[up], spread[up])
        np.add.at(count, up, 1.0)
        np.add.at(count, parent[up], 1.0)
        spread = np.where(pushed, shift, total / count[:, None])
    return spread
