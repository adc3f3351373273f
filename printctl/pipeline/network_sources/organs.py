"""Grow the trees of the organ that a recipe names."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from design.anatomy.curves import curved_network
from design.anatomy.organ import PRESETS, AnatomicTrees, grow_or_advise, uneven_notes
from design.anatomy.organs.cortex import CortexAnatomy, grow_cortex
from design.anatomy.organs.heart import HeartAnatomy, grow_heart
from design.anatomy.organs.kidney import KidneyAnatomy, grow_kidney
from design.anatomy.organs.liver import LiverAnatomy, grow_liver
from design.network import VesselNetwork
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature import GrowthOptions, check_supply, terminals_of
from printctl.errors import RecipeError
from printctl.pipeline.network_sources.options import growth_options
from printctl.recipe.sections.anatomy import AnatomyPart
from printctl.recipe.sections.growth import GrownNetwork

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext


def organ_network(context: RunContext, part: GrownNetwork) -> tuple[VesselNetwork, dict[str, Any]]:
    """Grow the organ's trees and curve them."""
    trees = anatomic_trees(context, part)
    return curved_network(trees.trees, trees.kinds), {"notes": list(trees.notes)}


def anatomic_trees(context: RunContext, part: GrownNetwork) -> AnatomicTrees:
    """Grow the trees of the organ that the recipe names.

    Murray's exponent and the pressure drop are the template's unless the recipe gives them.
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
        preset.least_terminals,
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
    """Return the values that the recipe gives; the rest keep their defaults."""
    return {name: value for name, value in given.items() if value is not None}
