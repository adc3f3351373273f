"""Remove terminals from vessel trees: first of colliding vessels, then above a wanted number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.errors import CrowdedError, GrowthError
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_from_topology, tree_radii
from kernels.arrays import IntArray

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
    flow = tree.relative_flow[kept]
    left = float(flow[a < 0].sum()) * tree.terminal_flow_ul_s
    smaller = tree_from_topology(
        tree.proximal[kept],
        tree.distal[kept],
        parent.astype(np.int32),
        np.column_stack([a, b]).astype(np.int32),
        flow_ul_s=left,
        pressure_drop_pa=tree.pressure_drop_pa,
        murray_exponent=tree.murray_exponent,
        viscosity_pa_s=tree.viscosity_pa_s,
        relative_flow=flow,
        haematocrit=tree.haematocrit,
        given=tree.given[kept],
    )
    return replace(smaller, notes=tree.notes)


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
