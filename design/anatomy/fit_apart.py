"""Push colliding vessel trees apart, curve them, and prune to a given number of terminals."""

from __future__ import annotations

from math import ceil

from design.anatomy.curves import STRAIGHT
from design.anatomy.prune_terminals import trimmed, with_flow, without_collisions
from design.anatomy.push_apart import push_apart
from design.anatomy.round_trees import AGAIN, SECOND, Trees, curve_trees, kinks, misfits
from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.tree import VesselTree

SPARE = 1.2
"""Terminals to grow over those wanted."""

_LAST_SPARE = 0.1
"""Of those wanted, what is left to spare once the two are clear of each other."""


def fitted_apart(
    tissue: Tissue, trees: Trees, clearance_mm: float, clearance_ratio: float, terminals: int
) -> Trees:
    """Trees pushed apart, curved and pruned until all fits, with so many terminals each.

    Parameters
    ----------
    trees : tuple of VesselTree
        With some terminals to spare (`SPARE`); each keeps its flow.
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`.

    Raises
    ------
    GrowthError
        When too many terminals don't fit.
    """
    mm, ratio = clearance_mm, clearance_ratio
    done = tuple(with_flow(tree, float(tree.flow_ul_s[0]) / terminals) for tree in trees)
    # What is pruned for good goes before vessels are curved and fit closely.
    spare, least = ceil(_LAST_SPARE * terminals), STRAIGHT
    done = _trimmed(_clear(tissue, done, mm, ratio), terminals, spare)
    for _ in range(AGAIN):
        done = _trimmed(_clear(tissue, done, mm, ratio), terminals, spare)
        done, bad = curve_trees(tissue, done, mm, ratio, least)
        least = SECOND
        if bad[0] or len(bad[1]):
            continue
        done = _trimmed(done, terminals, spare)
        final = push_apart(tissue, _trimmed(done, terminals, 0), mm, ratio)
        bad = misfits(tissue, final, mm, ratio)
        if not bad[0] and not len(bad[1]) and not kinks(final):
            return final
        spare //= 4
    raise GrowthError(
        f"{len(bad[0])} pairs of vessels are too near, {len(bad[1])} pieces out of the tissue and "
        f"{kinks(done)} kinks are left after {AGAIN} rounds; ask for fewer terminals or a higher "
        "pressure_drop_mmhg"
    )


def _clear(tissue: Tissue, trees: Trees, mm: float, ratio: float) -> Trees:
    """The trees pushed apart, without what then doesn't fit."""
    for _ in range(AGAIN):
        trees = push_apart(tissue, trees, mm, ratio)
        bad = misfits(tissue, trees, mm, ratio)
        if not bad[0] and not len(bad[1]):
            break
        trees = without_collisions(trees, *bad)
    return trees


def _trimmed(trees: Trees, terminals: int, spare: int) -> Trees:
    """The trees with so many terminals each, and so many to spare where they have them."""
    found: list[VesselTree] = []
    for tree in trees:
        most = max(terminals, min(terminals + spare, int(tree.terminals[0])))
        found += trimmed((tree,), most)
    return tuple(found)
