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
from design.anatomy.side_by_side import Companion, side_by_side, tube_options
from design.errors import CrowdedError, GrowthError, NoRoomError, WideTrunkError
from design.network import VesselKind
from design.tissue import Tissue
from design.tissue.demand import Demand
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

Trees = tuple[VesselTree, ...]

ATTEMPTS = 5
"""Growths with more room between trunks, where too many vessels don't fit."""

_MORE_ROOM = 0.15
_MOST_SPARE = 1.4
_LEAST_SPARE = 0.01
"""More terminals to spare with each attempt, of those asked for, though few didn't fit."""
_NEARLY = 0.95
"""Of the terminals asked for, from which on trunks don't need more room."""
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
    demand : Demand, optional
        By which the terminals were spread, where it isn't the tissue's own.
    """

    trees: tuple[VesselTree, ...]
    kinds: tuple[VesselKind, ...]
    names: tuple[str, ...]
    notes: tuple[str, ...]
    demand: Demand | None = None


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

    return _attempts(tissue, plan, _with_spare(options, SPARE), fitted, options)


def grow_apart(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow one tree from a plan's trunk; its vessels are pushed apart rather than sunk.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio

    def fitted(trees: Trees) -> Trees:
        flowing = tuple(_with_its_flow(tree, options.terminals) for tree in trees)
        return fitted_apart(tissue, flowing, mm, ratio, options.terminals)

    return _attempts(tissue, plan, _with_spare(options, SPARE), fitted, options)


def grow_pair(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow an artery and a vein beside it from a plan's trunks, with so many terminals each.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio

    def fitted(tubes: Trees) -> Trees:
        pair = side_by_side(_with_its_flow(tubes[0], options.terminals), options)
        return fitted_apart(tissue, pair, mm, ratio, options.terminals)

    return _attempts(tissue, plan, _with_spare(tube_options(options), SPARE_APART), fitted, options)


PORTAL_SHARE = 0.75
"""Of the liver's blood, that of the portal vein; the artery has the rest (Eipel et al. 2010,
doi 10.3748/wjg.v16.i48.6046: 75 to 80 %)."""

HEPATIC_ARTERY = Companion(drop=4.0, flow=1.0 / PORTAL_SHARE - 1.0, tube=1.48)
"""Beside the portal vein, then 0.54 times as wide. Four times its pressure drop is ours."""

HEPATIC_DROP = 0.5
"""Pressure drop along the hepatic veins over the portal vein's. Ours."""


def grow_portal(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow portal vein, artery beside it and hepatic veins from a plan's two trunks.

    Parameters
    ----------
    options : GrowthOptions
        Of the portal vein, but for the flow, which is the liver's.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio
    portal = replace(
        options, perfusion_ml_min_per_ml=PORTAL_SHARE * options.perfusion_ml_min_per_ml
    )
    hepatic = replace(options, pressure_drop_pa=HEPATIC_DROP * options.pressure_drop_pa)

    def fitted(trees: Trees) -> Trees:
        tubes, veins = (_with_its_flow(tree, options.terminals) for tree in trees)
        pair = side_by_side(tubes, portal, HEPATIC_ARTERY)
        return fitted_apart(tissue, (*pair, veins), mm, ratio, options.terminals)

    each = tuple(
        _with_spare(one, SPARE_APART) for one in (tube_options(portal, HEPATIC_ARTERY), hepatic)
    )
    return _attempts(tissue, replace(plan, each=each), each[0], fitted, options)


def _with_its_flow(tree: VesselTree, terminals: int) -> VesselTree:
    """The tree whose terminals to spare go in the end: the others get their flow."""
    return with_flow(tree, float(tree.flow_ul_s[0]) / terminals)


def _with_spare(options: GrowthOptions, spare: float) -> GrowthOptions:
    """Options of growth: more terminals and clearance than are kept once vessels are curved."""
    return replace(
        options,
        terminals=ceil(spare * options.terminals) + 8,
        clearance_mm=_CLEARER * options.clearance_mm,
        clearance_ratio=_CLEARER_RATIO * options.clearance_ratio,
    )


def _attempts(
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    fitted: Callable[[Trees], Trees],
    asked: GrowthOptions,
) -> Trees:
    """What ``fitted`` makes of the first growth that it doesn't refuse.

    Where terminals were too few, more are grown to spare; where they were far too few, or trunks
    didn't fit, trunks get more room each time.
    """
    error = GrowthError("not tried")
    best: CrowdedError | None = None
    room = 0
    for attempt in range(ATTEMPTS):
        wider = WIDER * (1.0 + _MORE_ROOM * room)
        # As many again as didn't fit last time.
        lacking = best.asked / max(1, best.fit) + _LEAST_SPARE * attempt if best else 1.0
        spare = min(_MOST_SPARE, lacking)
        each = tuple(_more(one, spare) for one in plan.each)
        settings = _more(options, spare)
        try:
            trees, _ = grow_from_plan(tissue, replace(plan, wider=wider, each=each), settings)
        except GrowthError as failed:
            if best is not None:
                error = failed
                break
            if isinstance(failed, WideTrunkError):
                raise
            raise _no_room(failed).around(
                after=f". For the {asked.terminals} terminals asked for, {asked.clearance_mm:g} mm "
                f"apart, {settings.terminals} are grown {settings.clearance_mm:.3g} mm apart: "
                "curves and vessels side by side need the room"
            ) from failed
        try:
            return fitted(trees)
        except CrowdedError as failed:
            best, error = max((best or failed, failed), key=lambda one: one.fit), failed
            room += failed.fit < _NEARLY * failed.asked
        except GrowthError as failed:
            if best is None and isinstance(failed, WideTrunkError):
                raise  # neither room nor terminals to spare help
            error = failed
            room += 1
    if best is not None:
        raise CrowdedError(best.fit, best.asked, f" (best of {ATTEMPTS} attempts)") from error
    raise _no_room(error).around(after=f" (last of {ATTEMPTS} attempts)") from error


def _no_room(error: GrowthError) -> NoRoomError:
    """What a growth was refused for: whatever it is, narrower vessels may fit."""
    return error if isinstance(error, NoRoomError) else NoRoomError(str(error))


def _more(options: GrowthOptions, spare: float) -> GrowthOptions:
    return replace(options, terminals=ceil(spare * options.terminals))
