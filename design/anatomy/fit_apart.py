"""Push colliding vessel trees apart, curve them, and prune to a given number of terminals."""

from __future__ import annotations

from math import ceil

import numpy as np

from design.anatomy.curves import STRAIGHT, main_children
from design.anatomy.prune_terminals import (
    first_tips,
    kept_segments,
    terminals_below,
    without_collisions,
    without_terminals,
)
from design.anatomy.push_apart import push_apart
from design.anatomy.round_trees import (
    AGAIN,
    SECOND,
    Misfits,
    Trees,
    curve_trees,
    kinked,
    kinks,
    misfits,
)
from design.errors import CrowdedError, GrowthError
from design.tissue import Tissue
from design.vasculature.tree import VesselTree

SPARE = 1.2
"""Terminals to grow over those wanted."""

_LAST_SPARE, _FEWEST_SPARE = 0.03, 0.001
"""Of those wanted, what is left to spare once all are clear of each other, and at last. Vessels
are curved and fit as they are with it: each that goes changes all radii a little."""

_ROOM = 1.04
"""Clearance that curves are fitted with, over that asked for: radii change a little when the last
spare terminals go."""


def fitted_apart(
    tissue: Tissue, trees: Trees, clearance_mm: float, clearance_ratio: float, terminals: int
) -> Trees:
    """Trees pushed apart, curved and pruned until all fits, with so many terminals each.

    Parameters
    ----------
    trees : tuple of VesselTree
        With some terminals to spare (`SPARE`), each with the flow that it keeps.
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`.

    Raises
    ------
    GrowthError
        When too many terminals don't fit.
    """
    mm, ratio = clearance_mm, clearance_ratio
    # What is pruned for good goes before vessels are curved and fit closely.
    done, least = _clear(tissue, trees, mm, ratio), STRAIGHT
    spare, fewest = ceil(_LAST_SPARE * terminals), ceil(_FEWEST_SPARE * terminals)
    final = done
    for _ in range(AGAIN):
        done = _clear(tissue, _trimmed(done, terminals, spare), mm, ratio)
        done, bad = curve_trees(tissue, done, mm, ratio, least, SECOND, _ROOM)
        least = SECOND
        if _any(bad):
            continue
        final = _trimmed(done, terminals, 0)
        if _any(misfits(tissue, final, mm, ratio)):
            final = push_apart(tissue, final, mm, ratio)
            if kinks(final):
                final, _ = curve_trees(tissue, final, mm, ratio, SECOND, SECOND)
        bad = misfits(tissue, final, mm, ratio)
        if not _any(bad) and not kinks(final):
            return final
        spare = max(fewest, spare // 4)
    raise GrowthError(
        f"{len(bad[0])} pairs of vessels are too near, {len(bad[1])} pieces out of the tissue and "
        f"{kinks(final)} kinks are left after {AGAIN} rounds; ask for fewer terminals or a higher "
        "pressure_drop_mmhg"
    )


def _any(bad: Misfits) -> bool:
    return bool(bad[0]) or bool(len(bad[1]))


def _clear(tissue: Tissue, trees: Trees, mm: float, ratio: float) -> Trees:
    """The trees pushed apart, without what then doesn't fit."""
    for _ in range(AGAIN):
        trees = push_apart(tissue, trees, mm, ratio, _ROOM)
        bad = misfits(tissue, trees, mm, ratio, _ROOM)
        if not _any(bad):
            break
        trees = without_collisions(trees, *bad)
    return trees


def _trimmed(trees: Trees, terminals: int, spare: int) -> Trees:
    """The trees with so many terminals each, and so many to spare where they have them."""
    fewest = min(int(tree.terminals[0]) for tree in trees)
    if fewest < terminals:
        raise CrowdedError(fewest, terminals)
    return tuple(
        _smooth(tree, min(terminals + spare, int(tree.terminals[0])) if spare else terminals)
        for tree in trees
    )


def _smooth(tree: VesselTree, terminals: int) -> VesselTree:
    """The tree with so many terminals; where it had no kinks it has none, as far as can be.

    A vessel goes on in its wider child, and of two nearly alike the other one may become the
    wider when terminals go: those of the wider one stay there, and others go.
    """
    extra = int(tree.terminals[0]) - terminals
    stay = np.zeros(len(tree.parent), dtype=np.bool_)
    smooth = extra > 0 and not kinks((tree,))
    for _ in range(AGAIN):
        gone = first_tips(tree, extra, stay)
        smaller = without_terminals(tree, gone)
        bent = kinked((smaller,)) if smooth else np.empty(0, dtype=np.int64)
        if not len(bent):
            break
        joints = np.flatnonzero(kept_segments(tree, gone))[bent]
        stay |= terminals_below(tree, main_children(tree)[joints])
    return smaller
