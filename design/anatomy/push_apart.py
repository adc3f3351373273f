"""Move nodes of several vessel trees until vessels keep their clearance and lie in the tissue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.anatomy.curves import derived_tree
from design.anatomy.trunk_depth import moved_tree
from design.anatomy.trunk_lines import outward
from design.errors import CrowdedError, GrowthError
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import FloatArray, IntArray

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


# Remove terminals from vessel trees: first of colliding vessels, then above a wanted number.

_STEADY = 4
"""Terminals of a vessel that hardly changes when one beside it is taken away."""


def without_terminals(tree: VesselTree, gone: NDArray[np.bool_]) -> VesselTree:
    """The tree without the terminals (n,) that are gone, and without what led to these alone.

    Each terminal that stays keeps its flow; a joint of one child left becomes a bend.

    Raises
    ------
    GrowthError
        When none would stay.
    """
    if not gone.any():
        return tree
    kept = kept_segments(tree, gone)
    if not kept[0]:
        raise GrowthError("no vessel of a tree fits where its trunk runs; move its inlet")
    number = np.cumsum(kept) - 1
    a, b = tree.children[kept].T.astype(np.int64)
    a = np.where((a >= 0) & kept[np.maximum(a, 0)], number[np.maximum(a, 0)], -1)
    b = np.where((b >= 0) & kept[np.maximum(b, 0)], number[np.maximum(b, 0)], -1)
    a, b = np.where(a < 0, b, a), np.where(a < 0, -1, b)
    parent = tree.parent[kept]
    parent = np.where(parent >= 0, number[np.maximum(parent, 0)], -1)
    left = float(tree.relative_flow[kept][a < 0].sum()) * tree.terminal_flow_ul_s
    return derived_tree(
        tree,
        tree.proximal[kept],
        tree.distal[kept],
        parent,
        np.column_stack([a, b]),
        np.flatnonzero(kept),
        flow_ul_s=left,
    )


def kept_segments(tree: VesselTree, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which segments (n,) lead to a terminal that stays; the order of the rest doesn't change."""
    kept = (tree.children[:, 0] < 0) & ~gone
    for i in downward_order(tree.children)[::-1]:
        if tree.parent[i] >= 0:
            kept[tree.parent[i]] |= kept[i]
    return kept


def terminals_below(tree: VesselTree, segments: IntArray) -> NDArray[np.bool_]:
    """Which segments are terminals at or below any of ``segments``."""
    below = np.zeros(len(tree.parent), dtype=np.bool_)
    below[segments] = True
    for i in downward_order(tree.children):
        if tree.parent[i] >= 0:
            below[i] |= below[tree.parent[i]]
    below &= tree.children[:, 0] < 0
    return below


def without_collisions(
    trees: Sequence[VesselTree], pairs: list[list[int]], out: IntArray
) -> tuple[VesselTree, ...]:
    """The trees without what feeds fewer terminals of each pair, and without what is out.

    Segments of all trees are numbered on.
    """
    first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
    fed = np.concatenate([tree.terminals for tree in trees])
    bad = [min(pair, key=lambda piece: (fed[piece], piece)) for pair in pairs] + out.tolist()
    kept = []
    for n, tree in enumerate(trees):
        mine = np.array([i - first[n] for i in bad if first[n] <= i < first[n + 1]], dtype=np.int64)
        kept.append(without_terminals(tree, terminals_below(tree, mine)))
    return tuple(kept)


def trimmed(trees: Sequence[VesselTree], terminals: int) -> tuple[VesselTree, ...]:
    """The trees with so many terminals together: the shortest side branches go first.

    Each tree gives in proportion to what it has; each terminal that stays keeps its flow.
    """
    counts = np.array([int(tree.terminals[0]) for tree in trees])
    extra = int(counts.sum()) - terminals
    if extra < 0:
        raise CrowdedError(int(counts.sum()), terminals)
    goes = np.floor(extra * counts / counts.sum()).astype(np.int64)
    goes[np.argmax(counts)] += extra - int(goes.sum())
    return tuple(
        without_terminals(tree, first_tips(tree, many))
        for tree, many in zip(trees, goes.tolist(), strict=True)
    )


def first_tips(
    tree: VesselTree, many: int, stay: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """Mark ``many`` terminals (n,) that are missed least; those that must ``stay`` come last."""
    tips = _side_tips(tree)
    if stay is not None:
        tips = np.concatenate([tips[~stay[tips]], tips[stay[tips]]])
    gone = np.zeros(len(tree.parent), dtype=np.bool_)
    gone[tips[:many]] = True
    return gone


def _side_tips(tree: VesselTree) -> IntArray:
    """Terminals by how little is lost with them: first those that leave a wider vessel.

    Of these, and of the others, the shortest first; a trunk's ends last.
    """
    radius = tree_radii(tree)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    tips = np.flatnonzero(tree.children[:, 0] < 0)
    # A terminal may end a run of pieces: follow it up to its joint.
    top, total = tips.astype(np.int64), length[tips]
    while True:
        above = tree.parent[top]
        on = (above >= 0) & (tree.children[np.maximum(above, 0), 1] < 0)
        if not on.any():
            break
        top = np.where(on, above, top)
        total = total + np.where(on, length[top], 0.0)
    above = np.maximum(tree.parent[top], 0)
    a, b = tree.children[above].T.astype(np.int64)
    beside = np.where(a == top, b, a)
    side = (radius[top] < radius[beside]) & (tree.terminals[beside] >= _STEADY)
    rank = np.where(tree.given[tips], 2, np.where(side & (tree.parent[top] >= 0), 0, 1))
    return np.asarray(tips[np.lexsort((total, rank))], dtype=np.int64)


def with_flow(tree: VesselTree, terminal_flow_ul_s: float) -> VesselTree:
    """The tree with another mean flow of its terminals; radii follow from the pressure drop."""
    return replace(tree, terminal_flow_ul_s=terminal_flow_ul_s)
