"""Grow the vessels of a recipe: a tree, a printable tree, an organ's trees or closed loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from design.anatomy.cortex import CortexAnatomy, grow_cortex
from design.anatomy.grown import AnatomicTrees, grow_or_advise, uneven_notes
from design.anatomy.heart import HeartAnatomy, grow_heart
from design.anatomy.kidney import KidneyAnatomy, grow_kidney
from design.anatomy.liver import LiverAnatomy, grow_liver
from design.anatomy.presets import PRESETS
from design.errors import LEAST_IN_CORTEX, LEAST_TERMINALS
from design.hemodynamics import FlowConditions, balance
from design.network import VesselKind
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature import (
    ClosedLoops,
    GrownParts,
    GrowthOptions,
    Inlet,
    PartSupply,
    RootSpec,
    VesselTree,
    check_supply,
    close_loops,
    grow_forest,
    grow_parts,
    grow_printable,
    grow_tree,
    terminals_of,
)
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.growth_source import growth_options, loop_options, read_trunk
from printctl.pipeline.printability import printability
from printctl.recipe.anatomy import AnatomyPart
from printctl.recipe.growth import ClosedLoop, GrownNetwork

_TOLD = 50
"""Parts of a tissue that the manifest lists at most, the largest first."""


def grown_parts(context: RunContext, part: GrownNetwork) -> GrownParts:
    """The trees that the recipe asks for, and what each part of the tissue gets."""
    if part.inlets is not None:
        options = growth_options(part, context.recipe.seed, context.recipe_folder)
        given = () if part.inlets == "each_part" else part.inlets
        places = [Inlet(one.at_mm, one.direction) for one in given]
        return grow_parts(context.tissue, options, places)
    tree = grown_tree(context, part)
    supply, notes = check_supply(context.tissue, *terminals_of([tree]))
    return GrownParts((tree,), supply, (*tree.notes, *notes))


def supply_report(supply: Sequence[PartSupply]) -> dict[str, Any]:
    """What the report says of a tissue of several parts; nothing of one part."""
    if len(supply) < 2:
        return {}
    return {"parts": len(supply), "supply": [asdict(one) for one in supply[:_TOLD]]}


def grown_tree(context: RunContext, part: GrownNetwork) -> VesselTree:
    """Grow the tree that the recipe asks for."""
    seed, folder = context.recipe.seed, context.recipe_folder
    options = growth_options(part, seed, folder)
    if part.printable:
        return printable_tree(context, part, options)
    return grow_tree(context.tissue, options, trunk=read_trunk(part, folder))


def anatomic_trees(context: RunContext, part: GrownNetwork) -> AnatomicTrees:
    """The trees of the organ that the recipe names.

    What the recipe leaves open of Murray's exponent and the pressure drop is the template's.
    """
    anatomy = part.anatomy
    if anatomy is None:
        raise RecipeError("the recipe names no anatomy; add anatomy: {template: ...}")
    options = growth_options(part, context.recipe.seed, context.recipe_folder)
    preset = PRESETS[anatomy.template]
    own = part.model_fields_set
    if "murray_exponent" not in own:
        options = replace(options, murray_exponent=preset.murray_exponent)
    if "pressure_drop_mmhg" not in own:
        options = replace(options, pressure_drop_pa=preset.pressure_drop_mmhg * PA_PER_MMHG)
    free = "pressure_drop_mmhg" not in own
    trees = grow_or_advise(
        lambda one: _grown(context.tissue, one, anatomy, free),
        options,
        LEAST_IN_CORTEX if anatomy.template == "cortex" else LEAST_TERMINALS,
        # Where another pressure drop doesn't fit, a heart keeps the one that does.
        lambda one: _grown(context.tissue, one, anatomy, False),
    )
    # A heart's coronaries share the tissue; of other organs each tree serves all of it.
    ends, flow = terminals_of(trees.trees if anatomy.template == "heart" else trees.trees[:1])
    tissue = replace(context.tissue, demand=trees.demand or context.tissue.demand)
    _, notes = check_supply(tissue, ends, flow)
    return replace(trees, notes=(*trees.notes, *notes, *uneven_notes(tissue, ends)))


def _grown(
    tissue: Tissue, options: GrowthOptions, part: AnatomyPart, published_radii: bool
) -> AnatomicTrees:
    at = {name: inlet.at_mm for name, inlet in part.inlets.items()}
    if part.template == "kidney":
        given: dict[str, Any] = {
            "hilum_mm": at.get("hilum"),
            "vein": part.vein,
            "cortex_mm": part.cortex_mm,
            "cortex_demand": part.cortex_demand,
            "trunk_ends": part.trunk_ends,
        }
        return grow_kidney(tissue, options, KidneyAnatomy(**_known(given)))
    if part.template == "liver":
        given = {
            "porta_mm": at.get("porta_hepatis"),
            "cava_mm": at.get("vena_cava"),
            "trunk_ends": part.trunk_ends,
        }
        return grow_liver(tissue, options, LiverAnatomy(**_known(given)))
    if part.template == "cortex":
        given = {
            "entry_mm": at.get("pial_artery"),
            "pial_direction": part.pial_direction,
            "thickness_mm": part.cortex_mm,
            "trunk_ends": part.trunk_ends,
            "trunk_depth_mm": part.trunk_depth_mm,
            "arterioles_per_mm2": part.arterioles_per_mm2,
        }
        return grow_cortex(tissue, options, CortexAnatomy(**_known(given)))
    given = {
        "trunk_ends": part.trunk_ends,
        "trunk_depth_mm": part.trunk_depth_mm,
        "base": part.base_direction,
        "right": part.right_direction,
        "left_ostium_mm": at.get("left_coronary"),
        "right_ostium_mm": at.get("right_coronary"),
        "published_radii": published_radii,
    }
    return grow_heart(tissue, options, HeartAnatomy(**_known(given)))


def _known(given: dict[str, Any]) -> dict[str, Any]:
    """What the recipe says; the rest is as by default."""
    return {name: value for name, value in given.items() if value is not None}


def printable_tree(context: RunContext, part: GrownNetwork, options: GrowthOptions) -> VesselTree:
    """As large a tree as needle and method can print; its notes say how far it got and why."""
    limits = printability(context, part.smallest_diameter_mm)
    wall = max(options.clearance_mm, limits.wall_mm)
    done = grow_printable(
        context.tissue,
        replace(options, smallest_radius_mm=limits.lumen_mm / 2, clearance_mm=wall),
        widest_radius_mm=None if limits.widest_mm is None else limits.widest_mm / 2,
    )
    kept = (
        f"lumens of {limits.lumen_mm:.3g} mm and walls of {wall:.3g} mm or more kept "
        f"({limits.says})"
    )
    notes = (kept, done.note) if done.note else (kept,)
    return replace(done.tree, notes=(*notes, *done.tree.notes))


def closed_loop(tissue: Tissue, part: ClosedLoop, seed: int) -> tuple[ClosedLoops, tuple[str, ...]]:
    """Artery and vein, grown in turn, and every terminal of the one joined to one of the other.

    Where a few had to be pruned, the others are balanced anew, by narrowing alone. With it come
    notes on what the artery or the vein doesn't reach.
    """
    artery = growth_options(part, seed)
    vein = replace(artery, root_point_mm=part.vein_root_mm, root_direction=part.vein_root_direction)
    roots = [RootSpec(artery, VesselKind.ARTERY), RootSpec(vein, VesselKind.VEIN)]
    arterial, venous = grow_forest(tissue, roots)
    notes = [
        f"{name}: {note}"
        for name, tree in (("artery", arterial), ("vein", venous))
        for note in check_supply(tissue, *terminals_of([tree]))[1]
    ]
    closed = close_loops(tissue, arterial, venous, loop_options(part, seed))
    return rebalanced(closed, artery, artery.flow_ul_s(tissue.volume_mm3)), tuple(notes)


def rebalanced(closed: ClosedLoops, options: GrowthOptions, flow_ul_s: float) -> ClosedLoops:
    """Equal flows again where terminals were pruned, by narrowing alone."""
    if not closed.pruned:
        return closed
    conditions = FlowConditions(options.viscosity_pa_s, inlet_flow_ul_s=flow_ul_s)
    thinnest = options.smallest_radius_mm or 0.0
    narrowed = balance(closed.network, conditions, widen=False, smallest_radius_mm=thinnest)
    return replace(closed, network=narrowed)


def loops_report(closed: ClosedLoops) -> dict[str, int]:
    """What the report says of how the loops were closed."""
    return {
        "connections": closed.connections,
        "routed": closed.routed,
        "shortened_terminals": closed.shortened,
        "pruned_pairs": closed.pruned,
    }
