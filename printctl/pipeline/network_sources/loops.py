"""Grow an artery and a vein and join their terminals to closed loops."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from design.hemodynamics import FlowConditions, balance
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature import (
    ClosedLoops,
    GrowthOptions,
    RootSpec,
    check_supply,
    close_loops,
    grow_forest,
    place_root,
    terminals_of,
)
from printctl.pipeline.network_sources.options import growth_options, loop_options
from printctl.recipe.sections.growth import ClosedLoop

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext


def loop_network(context: RunContext, part: ClosedLoop) -> tuple[VesselNetwork, dict[str, Any]]:
    """Grow the recipe's artery and vein as closed loops."""
    closed, notes = closed_loop(context.tissue, part, context.recipe.seed)
    facts = {"notes": list(notes)} if notes else {}
    return closed.network, {"loops": loops_report(closed), **facts}


def closed_loop(tissue: Tissue, part: ClosedLoop, seed: int) -> tuple[ClosedLoops, tuple[str, ...]]:
    """Grow artery and vein in turn; join every terminal of one to one of the other.

    Where a few had to be pruned, the others are balanced anew, by narrowing alone. The notes name
    where roots were put by default, and what the artery or the vein doesn't reach.
    """
    artery, notes = growth_options(part, seed), []
    if artery.root_candidates:
        artery, note = place_root(tissue, artery)
        notes.append(f"artery: {note}")
    vein = replace(artery, root_point_mm=part.vein_root_mm, root_direction=part.vein_root_direction)
    roots = [RootSpec(artery, VesselKind.ARTERY), RootSpec(vein, VesselKind.VEIN)]
    arterial, venous = grow_forest(tissue, roots)
    notes += [*arterial.notes, *venous.notes]
    notes += [
        f"{name}: {note}"
        for name, tree in (("artery", arterial), ("vein", venous))
        for note in check_supply(tissue, *terminals_of([tree]))[1]
    ]
    closed = close_loops(tissue, arterial, venous, loop_options(part, seed))
    return rebalanced(closed, artery, artery.flow_ul_s(tissue.volume_mm3)), tuple(notes)


def rebalanced(closed: ClosedLoops, options: GrowthOptions, flow_ul_s: float) -> ClosedLoops:
    """Restore equal flows where terminals were pruned, by narrowing alone."""
    if not closed.pruned:
        return closed
    conditions = FlowConditions(options.viscosity_pa_s, inlet_flow_ul_s=flow_ul_s)
    thinnest = options.smallest_radius_mm or 0.0
    narrowed = balance(closed.network, conditions, widen=False, smallest_radius_mm=thinnest)
    return replace(closed, network=narrowed)


def loops_report(closed: ClosedLoops) -> dict[str, int]:
    """Return the report's figures on how the loops were closed."""
    return {
        "connections": closed.connections,
        "shortened_terminals": closed.shortened,
        "pruned_pairs": closed.pruned,
    }
