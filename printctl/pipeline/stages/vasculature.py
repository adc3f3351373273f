"""Stage 2: the network, named, given or grown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from design.hemodynamics import FlowConditions, balance
from design.lattices import LatticeOptions, build_lattice
from design.network import VesselKind, VesselNetwork
from design.network_csv import read_network_csv, write_network_csv
from design.tissue import Tissue
from design.vasculature import (
    ClosedLoops,
    GrowthOptions,
    LoopOptions,
    RootSpec,
    VesselTree,
    check_network,
    close_loops,
    grow_forest,
    grow_tree,
    planar_four_vessel,
    tree_to_network,
)
from design.vasculature.polish import PolishOptions, polish
from printctl.pipeline.context import NETWORK, RunContext
from printctl.pipeline.growth_source import growth_options, read_trunk
from printctl.pipeline.manifest import digest_file
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.tissue import SURFACE
from printctl.progress import Report
from printctl.recipe.growth import (
    ClosedLoop,
    GivenNetwork,
    GrownNetwork,
    NamedNetwork,
    files_of,
)
from printctl.recipe.lattice import LatticeNetwork


def depends(context: RunContext) -> Any:
    """The section, the seed, and the user's file where it names one."""
    part = context.recipe.vasculature
    found = part.model_dump(mode="json")
    files = {name: context.recipe_folder / name for name in files_of(part)}
    found["digests"] = {name: digest_file(path) for name, path in files.items() if path.is_file()}
    return [found, context.recipe.seed]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Make the network and write it; later stages read the file."""
    part = context.recipe.vasculature
    more: dict[str, Any] = {}
    if isinstance(part, ClosedLoop):
        closed = closed_loop(context.tissue, part, context.recipe.seed)
        network, more = closed.network, {"loops": said_of(closed)}
    elif isinstance(part, GrownNetwork):
        tree = grown_tree(context, part)
        network, more = tree_to_network(tree, VesselKind.ARTERY), {"notes": list(tree.notes)}
        for note in tree.notes:
            context.bars.remark("vasculature", note)
    else:
        network = make_network(context)
    write_network_csv(context.folder / NETWORK, network)
    return summarise(network) | more, [NETWORK]


def grown_tree(context: RunContext, part: GrownNetwork) -> VesselTree:
    """The tree that the recipe asks for, polished if it says so."""
    seed, folder = context.recipe.seed, context.recipe_folder
    trunk = read_trunk(part, folder)
    tree = grow_tree(context.tissue, growth_options(part, seed, folder), trunk=trunk)
    if not part.polish:
        return tree
    polished = polish(context.tissue, tree, polish_options(part, seed)).tree
    return replace(polished, notes=tree.notes)


def make_network(context: RunContext) -> VesselNetwork:
    """The network that the recipe asks for, closed loops apart, in the tissue's frame."""
    part = context.recipe.vasculature
    match part:
        case NamedNetwork():
            network, clearance = planar_four_vessel(), 0.0
        case GivenNetwork():
            network = read_network_csv(context.recipe_folder / part.network, unit=part.unit)
            clearance = part.clearance_mm
        case LatticeNetwork():
            network, clearance = build_lattice(context.tissue, lattice_options(part)), 0.0
        case GrownNetwork():
            return tree_to_network(grown_tree(context, part), VesselKind.ARTERY)
        case ClosedLoop():
            return closed_loop(context.tissue, part, context.recipe.seed).network
    check_network(network, clearance)
    return network


def closed_loop(tissue: Tissue, part: ClosedLoop, seed: int) -> ClosedLoops:
    """Artery and vein, grown in turn, and every terminal of the one joined to one of the other.

    Where a few had to be pruned, the others are balanced anew, by narrowing alone.
    """
    artery = growth_options(part, seed)
    vein = replace(artery, root_point_mm=part.vein_root_mm, root_direction=part.vein_root_direction)
    roots = [RootSpec(artery, VesselKind.ARTERY), RootSpec(vein, VesselKind.VEIN)]
    arterial, venous = grow_forest(tissue, roots)
    thinnest = part.smallest_diameter_mm / 2 if part.smallest_diameter_mm else None
    joined = LoopOptions(seed=seed, clearance_mm=part.clearance_mm, smallest_radius_mm=thinnest)
    closed = close_loops(tissue, arterial, venous, joined)
    if not closed.pruned:
        return closed
    conditions = FlowConditions(
        artery.viscosity_pa_s, inlet_flow_ul_s=artery.flow_ul_s(tissue.volume_mm3)
    )
    narrowed = balance(closed.network, conditions, widen=False, smallest_radius_mm=thinnest or 0.0)
    return replace(closed, network=narrowed)


def said_of(closed: ClosedLoops) -> dict[str, int]:
    """What the report says of how the loops were closed."""
    return {
        "connections": closed.connections,
        "routed": closed.routed,
        "shortened_terminals": closed.shortened,
        "pruned_pairs": closed.pruned,
    }


def lattice_options(part: LatticeNetwork) -> LatticeOptions:
    """The recipe's words in the design's, which speak of radii."""
    wide = part.manifold_diameter_mm
    return LatticeOptions(
        kind=part.lattice,
        cell_mm=part.cell_mm,
        radius_mm=part.diameter_mm / 2,
        manifold_radius_mm=None if wide is None else wide / 2,
        axis=part.axis,
        clearance_mm=part.clearance_mm,
    )


def polish_options(part: GrownNetwork, seed: int) -> PolishOptions:
    """The constraints the tree was grown with."""
    return PolishOptions(
        seed=seed,
        clearance_mm=part.clearance_mm,
        clearance_ratio=GrowthOptions.clearance_ratio,
        length_to_radius=part.length_to_radius,
        branch_angle_degrees=part.branch_angle_degrees,
        turn_angle_degrees=part.turn_angle_degrees,
        flow_ratio=part.flow_ratio,
    )


def summarise(network: VesselNetwork) -> dict[str, Any]:
    """What the report says of a network."""
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    return {
        "vessels": network.vessel_count,
        "terminals": len(network.outlets()),
        "length_mm": float(length.sum()),
        "volume_mm3": float((np.pi / 3 * length * (r0 * r0 + r0 * r1 + r1 * r1)).sum()),
        "diameter_min_mm": float(2 * network.radius.min()),
        "diameter_max_mm": float(2 * network.radius.max()),
    }


STAGE = Stage("vasculature", depends, (SURFACE,), ("kernels", "design"), work)
