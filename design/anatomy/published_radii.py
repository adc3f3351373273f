"""Match a heart's radii to published ones by another pressure drop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.curves import curved_network
from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.main_branches import missing_branches, trunk_pieces
from design.anatomy.organ import Trees, grow_trees
from design.errors import GrowthError
from design.measures.published_comparison import PublishedMatch, published_match
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from kernels.arrays import FloatArray


class _Match(NamedTuple):
    """What another pressure drop mustn't cost for radii nearer to the published ones."""

    drops: int = 3  # that are tried at most
    # Of the trunks' length, that it must keep; of the planned length, below which the notes say so:
    # smoothed they are a twentieth shorter.
    laid: float = 0.85
    reach: float = 1.15  # distance of 99 % of the tissue from a terminal over that before


MATCH = _Match()


def with_published_radii(
    trees: Trees,
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    volume: FloatArray,
) -> Trees:
    """Return trees whose radii are the published ones, else others grown with another drop.

    Trees that don't fit then, lack trunks, a main branch or supply of some places of ``volume``, or
    are farther from the table aren't taken; half of the change is tried then. There are some
    already, so that vessels that find no room aren't tried again from other random numbers.
    """
    once, least = replace(plan, tries=1), MATCH.laid * trunks_mm(trees)
    most_mm = MATCH.reach * _reach_mm(volume, trees)
    missing = len(missing_branches(plan.main, trunk_pieces(trees)))
    match = _published_match(trees)
    factor = match.factor
    for _ in range(MATCH.drops):
        if factor == 1.0:
            break
        drop = trees[0].pressure_drop_pa / factor**4
        factor = factor**0.5
        try:
            other = grow_trees(tissue, once, replace(options, pressure_drop_pa=drop))
        except GrowthError:
            continue
        found = _published_match(other)
        lost = len(missing_branches(plan.main, trunk_pieces(other)))
        # Wider trunks that cost many branches aren't worth nearer figures.
        if (
            trunks_mm(other) > least
            and _reach_mm(volume, other) <= most_mm
            and found.farthest_sd < match.farthest_sd
            and lost <= missing
        ):
            trees, match, factor, missing = other, found, found.factor, lost
    return trees


def _reach_mm(volume: FloatArray, trees: Trees) -> float:
    """Return the way, mm, from the nearest terminal within which 99 % of places (n, 3) lie."""
    ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
    return float(np.percentile(cKDTree(ends).query(volume)[0], 99.0))


def _published_match(trees: Sequence[VesselTree]) -> PublishedMatch:
    kinds = (VesselKind.ARTERY,) * len(trees)
    return published_match(curved_network(trees, kinds), "coronary")


def trunks_mm(trees: Trees) -> float:
    """Return the length of all trunks, mm."""
    pieces = np.concatenate([(tree.distal - tree.proximal)[tree.given] for tree in trees])
    return float(np.linalg.norm(pieces, axis=1).sum())
