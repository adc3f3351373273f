"""Warn, by vessel and place, of lumens that the construct holds otherwise than the network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.network import VesselNetwork
from design.tissue import Tissue
from design.vasculature import collisions
from kernels.arrays import FloatArray, IntArray

NAMED: Final = 3
"""Vessels or pairs that a note names, the worst first; the others are counted."""
_MOUTH_RADII: Final = 3.0
"""So near to a port, in its radii, a lumen opens through the surface as it should."""


@dataclass(frozen=True)
class ConstructDesign:
    """Design that a construct was made from, in its own size.

    Attributes
    ----------
    network : VesselNetwork
    tissue : Tissue
    ports : (k,) int64
        Nodes at which lumens open.
    scale : float
        Of the print, whose places are told.
    """

    network: VesselNetwork
    tissue: Tissue
    ports: IntArray
    scale: float = 1.0

    def text(self, point: FloatArray) -> str:
        """A place of the print, as solid.stl and network.csv have it."""
        return "({:.4g}, {:.4g}, {:.4g}) mm".format(*(self.scale * point).tolist())


def no_ports_note(design: ConstructDesign, *, boxed: bool = False) -> str:
    """Sentence on a construct without ports: which free ends come nearest to the surface.

    ``boxed``: the tissue is the box around the network, as the recipe names none.
    """
    network = design.network
    free = np.flatnonzero(network.degree() == 1)
    text = (
        "no vessel's end opens through the tissue's surface (0 ports): the lumens are closed "
        "cavities, which nothing can be fed into or washed out of; "
    )
    text += (
        "the recipe names no tissue, so its box reaches beyond every vessel (tissue.margin_mm): "
        "give a tissue whose surface an inlet and an outlet reach"
        if boxed
        else "let an inlet and an outlet reach the surface"
    )
    if len(free) == 0:
        return f"{text} (no vessel has a free end)"
    depth = -design.tissue.grid.distance(network.nodes[free])
    nearest = np.argsort(depth)[:NAMED]
    named = [
        f"vessel {_vessel_at(network, int(free[k]))} at {design.text(network.nodes[free[k]])}, "
        f"{design.scale * depth[k]:.2g} mm below it"
        for k in nearest
    ]
    return f"{text}; the free ends nearest to it: {'; '.join(named)}"


def handles_note(design: ConstructDesign, genus: int, expected: int) -> str:
    """Sentence on handles that differ: where lumens break out, and which vessels merge.

    Parameters
    ----------
    design : ConstructDesign
    genus, expected : int
        Handles of the construct, as read back, and by the network (`design.solids.topology`).
    """
    places = [*_broken_walls(design), *_merged(design)] or [
        "a lumen breaks through the tissue's surface beside its ends, or vessels merge that the "
        "network keeps apart; where wasn't found: compare solid.stl with network.csv"
    ]
    return (
        f"the construct has {genus} handles, the network asks for {expected}: {'; '.join(places)}; "
        "flows are those of the network, not of this construct; move or thin these vessels"
    )


def _broken_walls(design: ConstructDesign) -> list[str]:
    """Vessels whose wall lies beyond the tissue's surface away from their ports."""
    network = design.network
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    steps = np.maximum(np.ceil(2 * length / np.maximum(np.minimum(r0, r1), 1e-6)), 1).astype(int)
    piece = np.repeat(np.arange(len(steps)), steps + 1)
    first = np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    share = (np.arange(len(piece)) - first) / steps[piece]
    place = start[piece] + share[:, None] * (end - start)[piece]
    radius = r0[piece] + share * (r1 - r0)[piece]
    beyond = design.tissue.grid.distance(place) + radius
    for port in design.ports.tolist():
        away = np.linalg.norm(place - network.nodes[port], axis=1)
        beyond[away < _MOUTH_RADII * radius] = -np.inf
    worst = _worst_of_each(vessel[piece], beyond)
    if not worst:
        return []
    named = [
        f"vessel {vessel[piece[k]]} by {design.scale * beyond[k]:.2g} mm at {design.text(place[k])}"
        for k in worst[:NAMED]
    ]
    return [
        "lumens break through the tissue's surface beside their ends: "
        f"{', '.join(named)}{_more(worst)}"
    ]


def _worst_of_each(vessel: IntArray, beyond: FloatArray) -> list[int]:
    """Index of each vessel's farthest place beyond the surface, the worst vessel first."""
    order = np.argsort(-beyond, kind="stable")
    order = order[beyond[order] > 0]
    _, first = np.unique(vessel[order], return_index=True)
    return [int(k) for k in order[np.sort(first)]]


def _merged(design: ConstructDesign) -> list[str]:
    """Vessels that run into each other without a joint."""
    pairs = collisions(design.network)
    if not pairs.count:
        return []
    order = np.argsort(pairs.gap_mm, kind="stable")
    _, first = np.unique(np.sort(pairs.vessels[order], axis=1), axis=0, return_index=True)
    worst = [int(k) for k in order[np.sort(first)]]
    named = [
        f"{pairs.vessels[k][0]} and {pairs.vessels[k][1]} by {-design.scale * pairs.gap_mm[k]:.3g}"
        f" mm at {design.text(pairs.place_mm[k])}"
        for k in worst[:NAMED]
    ]
    return [f"vessels merge that the network keeps apart: {', '.join(named)}{_more(worst)}"]


def _more(found: list[int]) -> str:
    return f" and {len(found) - NAMED} more" if len(found) > NAMED else ""


def _vessel_at(network: VesselNetwork, node: int) -> int:
    return int(np.flatnonzero((network.vessel_nodes == node).any(axis=1))[0])
