"""Grow the arterial trees of a recipe: one, one for each part, or a printable one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from design.anatomy.curves import curved_network
from design.anatomy.fitting.bends import curve_trees, kinks
from design.anatomy.fitting.goal import KINK, Clearance
from design.errors import GrowthError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.parts import (
    GrownParts,
    Inlet,
    grow_parts,
    parts_to_network,
    terminals_of,
)
from design.vasculature.growth.printable import grow_printable
from design.vasculature.growth.supply import PartSupply, check_supply
from design.vasculature.growth.tree import grow_tree
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from printctl.pipeline.network_sources.options import growth_options, read_trunk
from printctl.recipe.sections.growth import GrownNetwork

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext

MAX_LISTED_PARTS = 50
"""Parts of a tissue in the manifest, the largest first."""


def tree_network(context: RunContext, part: GrownNetwork) -> tuple[VesselNetwork, dict[str, Any]]:
    """Grow the recipe's tree, or one in each part of the tissue."""
    grown = grown_parts(context, part)
    if part.curves:
        grown = curved(context.tissue, grown, part)
        network = curved_network(grown.trees, [VesselKind.ARTERY] * len(grown.trees))
    else:
        network = parts_to_network(grown)
    return network, {"notes": list(grown.notes), **supply_report(grown.supply)}


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
    return {"parts": len(supply), "supply": [asdict(one) for one in supply[:MAX_LISTED_PARTS]]}


def grown_tree(context: RunContext, part: GrownNetwork) -> VesselTree:
    """Grow the tree that the recipe asks for."""
    seed, folder = context.recipe.seed, context.recipe_folder
    options = growth_options(part, seed, folder)
    if part.printable:
        return printable_tree(context, part, options)
    return grow_tree(context.tissue, options, trunk=read_trunk(part, folder))


def printable_tree(context: RunContext, part: GrownNetwork, options: GrowthOptions) -> VesselTree:
    """As large a tree as needle and method can print; its notes say how far it got and why."""
    limits = context.printability(part.smallest_diameter_mm)
    wall = max(options.clearance_mm, limits.wall_mm)
    done = grow_printable(
        context.tissue,
        replace(options, smallest_radius_mm=limits.lumen_mm / 2, clearance_mm=wall),
        widest_radius_mm=None if limits.widest_mm is None else limits.widest_mm / 2,
    )
    kept = (
        f"lumens of {limits.lumen_mm:.3g} mm and walls of {wall:.3g} mm or more kept "
        f"({limits.source})"
    )
    notes = (kept, done.note) if done.note else (kept,)
    return replace(done.tree, notes=(*notes, *done.tree.notes))


def curved(tissue: Tissue, grown: GrownParts, part: GrownNetwork) -> GrownParts:
    """The same trees with curves in the place of bends, clear of each other and in the tissue.

    Main lines go through joints without a kink; a curve that would come too near to another vessel
    or leave the tissue is made shorter. Terminals stay where they are, and flows as they were:
    radii are derived anew from the curves' lengths. A note says how many sharp turns were there
    before and are left.

    Raises
    ------
    GrowthError
        When even the shortest curves have no room.
    """
    clearance = Clearance(part.clearance_mm, part.clearance_ratio)
    trees, (pairs, outside) = curve_trees(tissue, grown.trees, clearance)
    if len(pairs) or len(outside):
        raise GrowthError(
            f"curves: {len(pairs)} pairs of vessels would come nearer than the clearance and "
            f"{len(outside)} pieces leave the tissue; leave curves out, or grow with more "
            "clearance_mm"
        )
    before, after = (kinks(some, of_root=0.0) for some in (grown.trees, trees))
    note = f"turns of main lines by more than {KINK:g} degrees: {before} as grown, {after} curved"
    return replace(grown, trees=trees, notes=(*grown.notes, note))
