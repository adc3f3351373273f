"""Stage 2: load a shipped or given vessel network, grow one or build a lattice; write it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.anatomy.curves import curved_network
from design.anatomy.fit import KINK, Clearance, curve_trees, kinks
from design.errors import GrowthError
from design.hemodynamics import scaled_network
from design.lattices import build_lattice
from design.network import VesselKind, VesselNetwork
from design.network_files.by_suffix import read_with_notes
from design.network_files.csv_format import write_network_csv
from design.network_files.json_format import write_network_npz
from design.tissue import Tissue
from design.vasculature import (
    GrownParts,
    check_given_once,
    check_network,
    check_parts,
    collisions,
    parts_to_network,
    planar_four_vessel,
)
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.growing import (
    anatomic_trees,
    closed_loop,
    grown_forest,
    grown_parts,
    loops_report,
    supply_report,
)
from printctl.pipeline.printability import printability
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.forest import Forest
from printctl.recipe.growth import ClosedLoop, GivenNetwork, GrownNetwork, NamedNetwork
from printctl.recipe.model import LatticeNetwork
from printctl.run_folder.artefacts import NETWORK, NETWORK_ARRAYS, SURFACE

# Report how much of a given network lies outside the tissue; refuse what can't be meant.

_PLACES: Final = 400
"""Along the longest side of the tissue, at which vessels are looked at."""
_TOLD: Final = 0.02
"""Of the vessels' length; ends that stand out of the tissue, so that they can be fed, are usual."""
_HOLLOW: Final = 0.5
"""Of the vessels' length, from which a tissue's channels are those vessels."""
_WALL_RADII: Final = 1.4
"""Distance of a channel's wall from its vessel's axis at most, in radii; it may be narrower."""
_DIRECTIONS: Final = 8
_WALLED: Final = 0.6
"""Of the directions across a vessel; beyond others neighbouring channels may be hollow, too."""


def outside_note(tissue: Tissue, network: VesselNetwork) -> tuple[str, ...]:
    """A sentence on vessels outside the tissue, which nothing is cut out for; none for few.

    Raises
    ------
    RecipeError
        When no vessel lies in the tissue, or vessels reach farther beyond it than it is long, or
        they are cut out of it already.
    """
    low, high = (bound(tissue.surface.vertices, axis=0) for bound in (np.min, np.max))
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.clip(np.ceil(length * _PLACES / (high - low).max()), 1, _PLACES).astype(np.int64)
    piece = np.repeat(np.arange(len(length)), count)
    along = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[
        piece
    ]
    places = start[piece] + along[:, None] * (end - start)[piece]
    outside = ~tissue.contains(np.ascontiguousarray(places))
    share = (length / count)[piece]
    total, out = float(share.sum()), float(share[outside].sum())
    if out <= _TOLD * total:
        return ()
    depth = tissue.grid.distance(np.ascontiguousarray(places[outside]))
    wide = (r0[piece] + r1[piece])[outside] / 2
    walls = _wall_share(tissue, places[outside], (end - start)[piece[outside]], depth, wide)
    hollow = float(share[outside] @ (walls >= _WALLED))
    if hollow >= _HOLLOW * total:
        raise RecipeError(
            f"the vessels are hollow in the tissue already: {hollow:.3g} of {total:.3g} mm of "
            "their axes run through empty channels. Give the solid outline without channels as "
            "the tissue, or print the mesh as it is: printctl slice MESH"
        )
    ends = np.concatenate([start, end])
    beyond = float(np.maximum(low - ends, ends - high).max())
    if outside.all() or beyond > (high - low).max():
        raise RecipeError(
            ("no vessel of the network lies in" if outside.all() else "vessels reach far beyond")
            + f" the tissue: vessels reach from {_text(ends.min(0))} to {_text(ends.max(0))} mm, "
            f"the tissue from {_text(low)} to {_text(high)} mm; move one of them, "
            "or see to the network's unit"
        )
    worst = places[outside][int(np.argmax(depth))]
    return (
        f"{out:.3g} of {total:.3g} mm of vessels lie outside the tissue, up to {depth.max():.3g} "
        f"mm at {_text(worst)} mm: nothing is cut out for them there",
    )


def _wall_share(
    tissue: Tissue, places: FloatArray, way: FloatArray, depth: FloatArray, radius: FloatArray
) -> FloatArray:
    """Share of directions across a vessel in which tissue lies behind its wall, (n,).

    0 where the tissue's surface, ``depth`` away from the axis, isn't the vessel's wall.
    """
    along = way / np.linalg.norm(way, axis=1)[:, None]
    aside = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    one = np.cross(along, aside)
    one /= np.linalg.norm(one, axis=1)[:, None]
    two = np.cross(along, one)
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    behind = np.zeros(len(places))
    for angle in angles.tolist():
        across = np.cos(angle) * one + np.sin(angle) * two
        behind += tissue.contains(places + 1.5 * radius[:, None] * across)
    return np.where(depth <= _WALL_RADII * radius, behind / _DIRECTIONS, 0.0)


def _text(point: np.ndarray) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*point)


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
