"""Grow an organ's vessel trees from planned trunks; retry until enough terminals fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil

from design.anatomy.fit_apart import SPARE as SPARE_APART
from design.anatomy.fit_apart import fitted_apart
from design.anatomy.from_trunks import WIDER, TrunkPlan, grow_from_plan
from design.anatomy.prune_terminals import with_flow
from design.anatomy.round_trees import SPARE, fitted_trees
from design.anatomy.side_by_side import side_by_side, tube_options
from design.errors import GrowthError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

Trees = tuple[VesselTree, ...]

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


def grow_fitted(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow trees from a plan's trunks, curve them and keep what fits: so many terminals in all.

    Raises
    ------
    TissueError, GrowthError
        As `grow_from_plan` and `fitted_trees`, after some attempts.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio

    def fitted(trees: Trees) -> Trees:
        shallow = plan.shallow_mm if plan.exactly else None
        return fitted_trees(tissue, trees, mm, ratio, options.terminals, shallow_mm=shallow)

    return _attempts(tissue, plan, _with_spare(options, SPARE), fitted)


def grow_apart(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow one tree from a plan's trunk; its vessels are pushed apart rather than sunk.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio

    def fitted(trees: Trees) -> Trees:
        return fitted_apart(tissue, trees, mm, ratio, options.terminals)

    return _attempts(tissue, plan, _with_spare(options, SPARE), fitted)


def grow_pair(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow an artery and a vein beside it from a plan's trunks, with so many terminals each.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio

    def fitted(tubes: Trees) -> Trees:
        # Those to spare go in the end, and the others get their flow.
        flow = float(tubes[0].flow_ul_s[0]) / options.terminals
        pair = side_by_side(with_flow(tubes[0], flow), options)
        return fitted_apart(tissue, pair, mm, ratio, options.terminals)

    return _attempts(tissue, plan, _with_spare(tube_options(options), SPARE_APART), fitted)


def _with_spare(options: GrowthOptions, spare: float) -> GrowthOptions:
    """Options of growth: more terminals and clearance than are kept once vessels are curved."""
    return replace(
        options,
        terminals=ceil(spare * options.terminals) + 8,
        clearance_mm=_CLEARER * options.clearance_mm,
        clearance_ratio=_CLEARER_RATIO * options.clearance_ratio,
    )


def _attempts(
    tissue: Tissue, plan: TrunkPlan, options: GrowthOptions, fitted: Callable[[Trees], Trees]
) -> Trees:
    """What ``fitted`` makes of the first growth that it doesn't refuse."""
    error = GrowthError("not tried")
    for attempt in range(ATTEMPTS):
        wider = WIDER * (1.0 + _MORE_ROOM * attempt)
        trees, _ = grow_from_plan(tissue, replace(plan, wider=wider), options)
        try:
            return fitted(trees)
        except GrowthError as failed:
            error = failed
    raise GrowthError(f"{error} (last of {ATTEMPTS} attempts)") from error
