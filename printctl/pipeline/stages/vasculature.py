"""Stage 2: load a shipped or given vessel network, grow one or build a lattice; write it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.anatomy.published_drop import curved_network
from design.hemodynamics import scaled_network
from design.lattices import build_lattice
from design.network import VesselKind, VesselNetwork
from design.network_files.by_suffix import read_with_notes
from design.network_files.csv_format import write_network_csv
from design.network_files.npz import write_network_npz
from design.vasculature import (
    check_given_once,
    check_network,
    check_parts,
    collisions,
    parts_to_network,
    planar_four_vessel,
)
from printctl.pipeline.context import RunContext
from printctl.pipeline.curving import curved
from printctl.pipeline.growing import (
    anatomic_trees,
    closed_loop,
    grown_parts,
    loops_report,
    supply_report,
)
from printctl.pipeline.growing_forest import grown_forest
from printctl.pipeline.outside import outside_note
from printctl.pipeline.printability import printability
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.forest import Forest
from printctl.recipe.growth import (
    ClosedLoop,
    GivenNetwork,
    GrownNetwork,
    NamedNetwork,
)
from printctl.recipe.lattice import LatticeNetwork
from printctl.run_folder.artefacts import NETWORK, NETWORK_ARRAYS, SURFACE

DESIGNED = "network_designed.csv"
"""In the design's size, where the print's is another."""

LARGE = 100_000
"""Vessels from which the network is written as arrays too: read and written many times faster."""


def depends(context: RunContext) -> Any:
    """The section, the seed, the user's files where it names some, and what can be printed."""
    part = context.recipe.vasculature
    section = part.model_dump(mode="json")
    section["digests"] = context.digests(part.files())
    if isinstance(part, GrownNetwork) and part.printable:
        # What can be printed is said by the toolpath's section and its needle.
        limits = printability(context, part.smallest_diameter_mm)
        section["limits_mm"] = [limits.lumen_mm, limits.widest_mm, limits.wall_mm]
    return [section, context.recipe.seed, context.recipe.print_scale]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Make the network and write it in the print's size; later stages read the file."""
    network, more = make_network(context)
    for note in more.get("notes", ()):
        context.bars.remark("vasculature", note)
    scale, names = context.recipe.print_scale, [NETWORK]
    printed = scaled_network(network, scale)
    write_network_csv(context.folder / NETWORK, printed)
    if printed.vessel_count >= LARGE:
        write_network_npz(context.folder / NETWORK_ARRAYS, printed)
        names.append(NETWORK_ARRAYS)
    if scale != 1:
        write_network_csv(context.folder / DESIGNED, network)
        names.append(DESIGNED)
    return summarise(network) | more, names


def make_network(context: RunContext) -> tuple[VesselNetwork, dict[str, Any]]:
    """The network that the recipe asks for, in the design's size, and what is said of it."""
    part = context.recipe.vasculature
    notes: tuple[str, ...] = ()
    match part:
        case NamedNetwork():
            network, clearance = planar_four_vessel(), 0.0
        case GivenNetwork():
            network, notes = read_with_notes(context.recipe_folder / part.network, part.unit)
            notes += parts_note(network) + outside_note(context.tissue, network)
            clearance = part.clearance_mm
            if part.overlaps == "tell":
                check_given_once(network)
                notes += overlap_note(network, clearance)
                return network, {"notes": list(notes)}
        case LatticeNetwork():
            network, clearance = build_lattice(context.tissue, part.options()), 0.0
            check_parts(context.tissue, network.nodes)
        case GrownNetwork() if part.anatomy is not None:
            trees = anatomic_trees(context, part)
            return curved_network(trees.trees, trees.kinds), {"notes": list(trees.notes)}
        case GrownNetwork():
            grown = grown_parts(context, part)
            if part.curves:
                grown = curved(context.tissue, grown, part)
                network = curved_network(grown.trees, [VesselKind.ARTERY] * len(grown.trees))
            else:
                network = parts_to_network(grown)
            return network, {"notes": list(grown.notes), **supply_report(grown.supply)}
        case ClosedLoop():
            closed, notes = closed_loop(context.tissue, part, context.recipe.seed)
            facts = {"notes": list(notes)} if notes else {}
            return closed.network, {"loops": loops_report(closed), **facts}
        case Forest():
            return grown_forest(context.tissue, part, context.recipe.seed, context.recipe_folder)
    check_network(network, clearance)
    return network, {"notes": list(notes)} if notes else {}


def overlap_note(network: VesselNetwork, clearance_mm: float) -> tuple[str, ...]:
    """A sentence on vessels nearer than the clearance where they don't meet; none without any."""
    pairs = collisions(network, clearance_mm)
    if not pairs.count:
        return ()
    worst = int(np.argmin(pairs.gap_mm))
    one, two = pairs.vessels[worst].tolist()
    x, y, z = pairs.place_mm[worst].tolist()
    return (
        f"Places where vessels are nearer than {clearance_mm:g} mm without meeting: {pairs.count} "
        f"(overlaps: tell); nearest are vessels {one} and {two}, {pairs.gap_mm[worst]:.3g} mm "
        f"apart at ({x:.4g}, {y:.4g}, {z:.4g}) mm",
    )


def parts_note(network: VesselNetwork) -> tuple[str, ...]:
    """A sentence on parts that share no node, and how near their nodes come; none of one part."""
    ends = network.vessel_nodes
    used = np.unique(ends)
    links = coo_matrix((np.ones(len(ends)), ends.T), shape=(len(network.nodes),) * 2)
    number = connected_components(links, directed=False)[1]
    parts = np.unique(number[used])
    if len(parts) == 1:
        return ()
    largest = parts[np.argmax([np.count_nonzero(number[used] == one) for one in parts])]
    apart = used[number[used] != largest]
    near = cKDTree(network.nodes[used[number[used] == largest]])
    away, _ = near.query(network.nodes[apart])
    place = network.nodes[apart[int(np.argmin(away))]]
    return (
        f"The network has {len(parts)} parts that share no node; {len(np.unique(apart))} nodes "
        f"aren't joined to the largest, the nearest of them {away.min():.3g} mm from it, at "
        "({:.4g}, {:.4g}, {:.4g}) mm: each part needs an inlet of its own".format(*place),
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
