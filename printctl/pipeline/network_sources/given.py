"""Networks that are given: from a file, shipped, or a lattice; notes on a file's faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.lattices import build_lattice
from design.network import VesselNetwork
from design.network_files.by_suffix import read_with_notes
from design.tissue import Tissue
from design.vasculature import (
    check_given_once,
    check_network,
    check_parts,
    collisions,
    planar_four_vessel,
)
from design.vasculature.clipping import CutEnd, clip_ends
from kernels.arrays import FloatArray
from printctl.checks.lumens import list_names
from printctl.errors import RecipeError
from printctl.recipe.sections.growth import GivenNetwork, LatticeNetwork

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext


def given_network(context: RunContext, part: GivenNetwork) -> tuple[VesselNetwork, dict[str, Any]]:
    """Return the network of the recipe's file, its ends cut off at the tissue's surface.

    Raises
    ------
    RecipeError
        When it lies elsewhere than the tissue, or is hollow in it already.
    VasculatureError
        When vessels overlap, unless the recipe says ``overlaps: tell``.
    """
    network, notes = read_with_notes(context.recipe_folder / part.network, part.unit)
    network, cut = clip_ends(context.tissue, network)
    notes += cut_note(cut) + parts_note(network) + outside_note(context.tissue, network)
    if part.overlaps == "tell":
        check_given_once(network)
        notes += overlap_note(network, part.clearance_mm)
    else:
        check_network(network, part.clearance_mm)
    return network, {"notes": list(notes)} if notes or part.overlaps == "tell" else {}


def shipped_network() -> tuple[VesselNetwork, dict[str, Any]]:
    """Return the planar example of four vessels."""
    network = planar_four_vessel()
    check_network(network, 0.0)
    return network, {}


def lattice_network(
    context: RunContext, part: LatticeNetwork
) -> tuple[VesselNetwork, dict[str, Any]]:
    """Return the recipe's lattice of channels."""
    network = build_lattice(context.tissue, part.options())
    check_parts(context.tissue, network.nodes)
    check_network(network, 0.0)
    return network, {}


def cut_note(cut: Sequence[CutEnd]) -> tuple[str, ...]:
    """Describe the ends that were cut off at the surface; no note of none."""
    if not cut:
        return ()
    named = [
        f"vessel {one.vessel} by {one.length_mm:.2g} mm at {_text(np.round(one.at_mm, 3) + 0.0)} mm"
        for one in cut
    ]
    return (
        f"vessel ends outside the part were cut off at its surface ({len(cut)}): "
        f"{list_names(named)}",
    )


class OutsideLimits(NamedTuple):
    """When vessels count as outside the tissue, or as cut out of it already."""

    samples: int = 400  # along the longest side of the tissue
    unreported_share: float = 0.02  # of the vessels' length: ends stand out so that they can be fed
    hollow_share: float = 0.5  # of the vessels' length, from which channels are these vessels
    wall_radii: float = 1.4  # greatest distance of a channel's wall from its vessel's axis, radii
    directions: int = 8  # across a vessel, in which its channel's wall is sought
    walled_share: float = 0.6  # of the directions; in others a neighbouring channel may be hollow


_LIMITS: Final = OutsideLimits()


def outside_note(tissue: Tissue, network: VesselNetwork) -> tuple[str, ...]:
    """Describe vessels outside the tissue, which nothing is cut out for; no note for few.

    Raises
    ------
    RecipeError
        When no vessel lies in the tissue, or vessels reach farther beyond it than it is long, or
        they are cut out of it already.
    """
    low, high = (bound(tissue.surface.vertices, axis=0) for bound in (np.min, np.max))
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.clip(
        np.ceil(length * _LIMITS.samples / (high - low).max()), 1, _LIMITS.samples
    ).astype(np.int64)
    piece = np.repeat(np.arange(len(length)), count)
    along = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[
        piece
    ]
    places = start[piece] + along[:, None] * (end - start)[piece]
    outside = ~tissue.contains(np.ascontiguousarray(places))
    share = (length / count)[piece]
    total, out = float(share.sum()), float(share[outside].sum())
    if out <= _LIMITS.unreported_share * total:
        return ()
    depth = tissue.grid.distance(np.ascontiguousarray(places[outside]))
    wide = (r0[piece] + r1[piece])[outside] / 2
    walls = _wall_share(tissue, places[outside], (end - start)[piece[outside]], depth, wide)
    hollow = float(share[outside] @ (walls >= _LIMITS.walled_share))
    if hollow >= _LIMITS.hollow_share * total:
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
    """Return the share of directions across a vessel with tissue behind its wall, (n,).

    0 where the tissue's surface, ``depth`` away from the axis, isn't the vessel's wall.
    """
    along = way / np.linalg.norm(way, axis=1)[:, None]
    aside = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    one = np.cross(along, aside)
    one /= np.linalg.norm(one, axis=1)[:, None]
    two = np.cross(along, one)
    angles = 2 * np.pi * np.arange(_LIMITS.directions) / _LIMITS.directions
    behind = np.zeros(len(places))
    for angle in angles.tolist():
        across = np.cos(angle) * one + np.sin(angle) * two
        behind += tissue.contains(places + 1.5 * radius[:, None] * across)
    return np.where(depth <= _LIMITS.wall_radii * radius, behind / _LIMITS.directions, 0.0)


def _text(point: np.ndarray) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*point)


def overlap_note(network: VesselNetwork, clearance_mm: float) -> tuple[str, ...]:
    """Describe vessels nearer than the clearance where they don't meet; no note without any."""
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
    """Describe parts that share no node, and how near their nodes come; no note of one part."""
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
