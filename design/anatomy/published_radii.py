"""Match a heart's radii to published ones by another pressure drop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from design.anatomy.curves import curved_network
from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.organ import Trees, grow_trees
from design.errors import GrowthError
from design.measures.published_comparison import PublishedMatch, published_match
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree


class _Match(NamedTuple):
    """How far another pressure drop is looked for, and what it mustn't cost."""

    drops: int = 3  # that are tried at most
    # Of the trunks' length: six hearts kept 0.981 to 1.05 of it, one that lost branches 0.71.
    kept: float = 0.9
    # Of the planned length, below which the notes say so: smoothed they are a twentieth shorter.
    laid: float = 0.85


MATCH = _Match()


def with_published_radii(
    trees: Trees, tissue: Tissue, plan: TrunkPlan, options: GrowthOptions
) -> Trees:
    """Return trees with another drop if more of the published figures are theirs, else ``trees``.

    They must fit and keep their trunks; half of the change is tried where they don't, or match no
    more. There are some trees already, so that vessels that find no room aren't tried again from
    other random numbers.
    """
    once, least_mm = replace(plan, tries=1), MATCH.kept * trunks_mm(trees)
    within, factor = _published_match(trees)
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
        if found.within > within and trunks_mm(other) >= least_mm:
            trees, (within, factor) = other, found
    return trees


def _published_match(trees: Sequence[VesselTree]) -> PublishedMatch:
    kinds = (VesselKind.ARTERY,) * len(trees)
    return published_match(curved_network(trees, kinds), "coronary")


def trunks_mm(trees: Trees) -> float:
    """Return the length of all trunks, mm."""
    pieces = np.concatenate([(tree.distal - tree.proximal)[tree.given] for tree in trees])
    return float(np.linalg.norm(pieces, axis=1).sum())
