"""Remove terminals from vessel trees: first of colliding vessels, then above a wanted number."""

from __future__ import annotations

import numpy as np

from design.anatomy.curves import derived_tree, main_children
from design.anatomy.fitting.bends import kinked
from design.anatomy.fitting.goal import FIT, Goal, Misfits, Segments, Trees
from design.errors import CrowdedError, GrowthError
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import BoolArray, IntArray


def without(trees: Trees, bad: Misfits) -> Trees:
    """Return the trees without what feeds fewer terminals of each pair, and without what is out."""
    every = Segments.of(trees)
    a, b = bad.pairs.T
    a_goes = (every.fed[a] < every.fed[b]) | ((every.fed[a] == every.fed[b]) & (a < b))
    gone = np.zeros(len(every.fed), dtype=np.bool_)
    gone[np.where(a_goes, a, b)] = gone[bad.out] = True
    return tuple(
        without_terminals(tree, terminals_below(tree, gone[first : first + len(tree.parent)]))
        for tree, first in zip(trees, every.first[:-1], strict=True)
    )


def without_terminals(tree: VesselTree, gone: BoolArray) -> VesselTree:
    """Return the tree without the terminals (n,) that are gone, and what led to these alone.

    Each terminal that stays keeps its flow; a joint of one child left becomes a bend.

    Raises
    ------
    GrowthError
        When none would stay.
    """
    if not gone.any():
        return tree
    kept = _kept_segments(tree, gone)
    if not kept[0]:
        raise GrowthError("no vessel of a tree fits where its trunk runs; move its inlet")
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)  # the last one stands for none
    a, b = number[tree.children[kept]].T
    a, b = np.where(a < 0, b, a), np.where(a < 0, -1, b)
    left = float(tree.relative_flow[kept][a < 0].sum()) * tree.terminal_flow_ul_s
    return derived_tree(
        tree,
        tree.proximal[kept],
        tree.distal[kept],
        number[tree.parent[kept]],
        np.column_stack([a, b]),
        np.flatnonzero(kept),
        flow_ul_s=left,
    )


def _kept_segments(tree: VesselTree, gone: BoolArray) -> BoolArray:
    """Return which segments (n,) lead to a terminal that stays."""
    kept = (tree.children[:, 0] < 0) & ~gone
    for i in downward_order(tree.children)[::-1]:
        if tree.parent[i] >= 0:
            kept[tree.parent[i]] |= kept[i]
    return kept


def terminals_below(tree: VesselTree, segments: BoolArray) -> BoolArray:
    """Return which segments (n,) are terminals at or below any of ``segments`` (n,)."""
    below = segments.copy()
    for i in downward_order(tree.children):
        if tree.parent[i] >= 0:
            below[i] |= below[tree.parent[i]]
    return np.asarray(below & (tree.children[:, 0] < 0))


def trimmed(trees: Trees, goal: Goal, spare: int) -> Trees:
    """Return trees with as many terminals as are wanted, and some to spare where they have them."""
    counts = np.array([int(tree.terminals[0]) for tree in trees])
    have = int(counts.sum()) if goal.shared else int(counts.min())
    if have < goal.terminals:
        raise CrowdedError(have, goal.terminals)
    if goal.shared:  # each tree gives in proportion to what it has
        extra = max(have - goal.terminals - spare, 0)
        goes = np.floor(extra * counts / have).astype(np.int64)
        goes[np.argmax(counts)] += extra - int(goes.sum())
    else:
        goes = np.maximum(counts - goal.terminals - spare, 0)
    return tuple(_fewer(tree, many) for tree, many in zip(trees, goes.tolist(), strict=True))


def _fewer(tree: VesselTree, many: int) -> VesselTree:
    """Remove so many terminals of a tree; where it had no kinks it gets none, if possible.

    A vessel goes on in its wider child, and of two nearly alike the other one may become the
    wider when terminals go: those of the wider one stay there, and others go.
    """
    stay = np.zeros(len(tree.parent), dtype=np.bool_)
    smooth = many > 0 and not len(kinked(tree))
    for _ in range(FIT.rounds):
        tips = _side_tips(tree)
        gone = np.zeros(len(tree.parent), dtype=np.bool_)
        gone[np.concatenate([tips[~stay[tips]], tips[stay[tips]]])[:many]] = True
        smaller = without_terminals(tree, gone)
        bent = kinked(smaller) if smooth else np.empty(0, dtype=np.int64)
        if not len(bent):
            break
        wider = np.zeros(len(tree.parent), dtype=np.bool_)
        wider[main_children(tree)[np.flatnonzero(_kept_segments(tree, gone))[bent]]] = True
        stay |= terminals_below(tree, wider)
    return smaller


def _side_tips(tree: VesselTree) -> IntArray:
    """Return terminals by how little is lost with them: first those that leave a wider vessel.

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
    side = (radius[top] < radius[beside]) & (tree.terminals[beside] >= FIT.steady)
    rank = np.where(tree.given[tips], 2, np.where(side & (tree.parent[top] >= 0), 0, 1))
    return np.asarray(tips[np.lexsort((total, rank))], dtype=np.int64)
