"""Trees grown by an anatomic template: attempts, tree by tree, until all fits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

from design.anatomy.from_trunks import WIDER, TrunkPlan, grow_from_plan
from design.anatomy.round_trees import SECOND, SPARE, fitted_trees
from design.anatomy.side_by_side import side_by_side, tube_options
from design.errors import GrowthError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

ATTEMPTS = 5
"""Growths with more room between trunks, where too many vessels don't fit."""

_MORE_ROOM = 0.15
_CLEARER, _CLEARER_RATIO = 1.15, 1.3
"""Clearance to grow with, over that kept once vessels are curved."""


@dataclass(frozen=True)
class AnatomicTrees:
    """Trees of an organ.

    Attributes
    ----------
    trees : tuple of VesselTree
        With bends (segments of one child).
    kinds : tuple of VesselKind
    names : tuple of str
        Of their inlets.
    notes : tuple of str
        What was found in the shape, and chosen.
    """

    trees: tuple[VesselTree, ...]
    kinds: tuple[VesselKind, ...]
    names: tuple[str, ...]
    notes: tuple[str, ...]


def grow_fitted(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> tuple[VesselTree, ...]:
    """Grow trees from a plan's trunks, curve them and keep what fits: so many terminals in all.

    Raises
    ------
    TissueError, GrowthError
        As `grow_from_plan` and `fitted_trees`, after some attempts.
    """
    more = replace(
        options,
        terminals=ceil(SPARE * options.terminals) + 8,
        clearance_mm=_CLEARER * options.clearance_mm,
        clearance_ratio=_CLEARER_RATIO * options.clearance_ratio,
    )
    error = GrowthError("not tried")
    for attempt in range(ATTEMPTS):
        wider = WIDER * (1.0 + _MORE_ROOM * attempt)
        wide = replace(plan, wider=wider)
        trees, _ = grow_from_plan(tissue, wide, more)
        try:
            return fitted_trees(
                tissue,
                trees,
                options.clearance_mm,
                options.clearance_ratio,
                options.terminals,
            )
        except GrowthError as failed:
            error = failed
    raise GrowthError(f"{error} (last of {ATTEMPTS} attempts)") from error


def grow_pair(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> tuple[VesselTree, ...]:
    """Grow an artery and a vein beside it from a plan's trunks, with so many terminals each.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    more = replace(tube_options(options), terminals=ceil(SPARE * options.terminals) + 8)
    (tubes,) = grow_fitted(tissue, plan, more)
    return fitted_trees(
        tissue,
        side_by_side(tubes, options),
        options.clearance_mm,
        options.clearance_ratio,
        options.terminals,
        each=True,
        least=SECOND,
    )
