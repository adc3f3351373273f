"""Close arterial and venous trees into loops: every terminal joined to one of the other side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError, NetworkError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.connect import (
    STUB,
    Tips,
    Web,
    curve_shapes,
    empty_capsules,
    fill_capsules,
    list_some,
)
from design.vasculature.curves import KIN, PIECES, Rule
from design.vasculature.forest import forest_to_network, joined_networks
from design.vasculature.index import empty_index
from design.vasculature.matching import match_terminals
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class LoopOptions:
    """How terminals are joined.

    All connections get the same hydraulic resistance, r⁴ ~ length: with trees of equal terminal
    pressures every loop then carries the same flow.

    Attributes
    ----------
    seed : int
        Of the shapes tried beyond the first.
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`, between connections and everything, each other included. Trees
        grown with a little more leave room at their tips.
    bend_to_radius : float
        Least bend radius of a connection's axis over its lumen radius; at least 1.
    kink_degrees : float
        Largest angle between a terminal's vessel and the connection that continues it.
    radius_ratio : float
        Radius of a connection of typical length over the terminals' median radius.
    smallest_radius_mm : float, optional
        Instead: no connection is thinner.
    weight_length, weight_tortuosity, weight_clearance, weight_volume : float
        Of a candidate's length over the typical one, its length over its chord less 1, its lack
        of room (1 at none, 0 at four radii), and its volume over the typical one.
    """

    seed: int = 1
    clearance_mm: float = 0.0
    clearance_ratio: float = 0.1
    bend_to_radius: float = 2.0
    kink_degrees: float = 75.0
    radius_ratio: float = 0.75
    smallest_radius_mm: float | None = None
    weight_length: float = 1.0
    weight_tortuosity: float = 0.5
    weight_clearance: float = 0.5
    weight_volume: float = 0.5

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise GrowthError(f"{name} is {value:g}; give a value from {low:g} to {high:g}")


_LIMITS = (
    ("seed", 0, 2**63),
    ("clearance_mm", 0.0, 10.0),
    ("clearance_ratio", 0.0, 10.0),
    ("bend_to_radius", 1.0, 100.0),
    ("kink_degrees", 1.0, 85.0),
    ("radius_ratio", 0.1, 10.0),
    ("smallest_radius_mm", 1e-4, 10.0),
    ("weight_length", 0.0, 1e3),
    ("weight_tortuosity", 0.0, 1e3),
    ("weight_clearance", 0.0, 1e3),
    ("weight_volume", 0.0, 1e3),
)

_COMFORT = 4.0
_LONGER = 1.15
"""Length of a typical curve over its chord."""


def close_loops(
    tissue: Tissue,
    arterial: VesselTree | Sequence[VesselTree],
    venous: VesselTree | Sequence[VesselTree],
    options: LoopOptions | None = None,
) -> VesselNetwork:
    """Join every arterial terminal to a venous one by a smooth curve in the tissue.

    Terminals are matched with the least sum of distances. Each connection takes the cheapest of
    several cubic Bézier curves that fit; where none does, neighbours are laid anew, partners
    exchanged, and at last terminals shortened (the connection makes up for the resistance lost).
    All pairs of the result, curves included, are audited.

    Parameters
    ----------
    tissue : Tissue
    arterial, venous : VesselTree or sequence of VesselTree
        As many terminals on one side as on the other; trees that don't touch (`grow_forest`).
        Several of a side mix: a terminal may be joined to any tree of the other.
    options : LoopOptions, optional

    Returns
    -------
    VesselNetwork
        Arteries, veins (flow towards their roots) and connections (each a polyline; tree numbers
        go on after the trees').

    Raises
    ------
    GrowthError
        When the sides' terminals differ in number, or connections find no way (with the count).
    NetworkError
        When the audit finds collisions (with the count), between the trees given or else.
    """
    options = options or LoopOptions()
    sides = [_as_list(arterial), _as_list(venous)]
    kinds = [VesselKind.ARTERY] * len(sides[0]) + [VesselKind.VEIN] * len(sides[1])
    trees = [*sides[0], *sides[1]]
    network = forest_to_network(trees, kinds)
    web = _web(tissue, trees, len(sides[0]), options)
    web.lay_all()
    if len(web.failed):
        place = web.one.point[web.failed[0]]
        raise GrowthError(
            f"{len(web.failed)} of {len(web.radius)} connections found no way with clearance "
            f"{options.clearance_mm:g} mm and bends of {options.bend_to_radius:g} radii, one of "
            "them at ({:.4g}, {:.4g}, {:.4g}) mm; ".format(*place)
            + "grow the trees with more clearance, or ask for thinner connections, tighter bends "
            "or less clearance"
        )
    closed = joined_networks([network, _connections(web, len(trees))])
    closed = _merged(closed, len(network.nodes), web, trees, len(sides[0]))
    found = collisions(closed, options.clearance_mm, options.clearance_ratio)
    if found.count:
        raise NetworkError(
            f"the audit found {found.count} colliding pairs, first vessels "
            f"{found.vessels[0, 0]} and {found.vessels[0, 1]} with a gap of "
            f"{found.gap_mm[0]:.3g} mm; grow the trees as one forest with at least the loops' "
            "clearance"
        )
    return closed


def _as_list(trees: VesselTree | Sequence[VesselTree]) -> list[VesselTree]:
    return [trees] if isinstance(trees, VesselTree) else list(trees)


def _web(tissue: Tissue, trees: list[VesselTree], arterial: int, options: LoopOptions) -> Web:
    first = np.cumsum([0] + [len(tree.parent) for tree in trees])
    tips = [tree_tips(tree, int(at)) for tree, at in zip(trees, first, strict=False)]
    one, other = _together(tips[:arterial]), _together(tips[arterial:])
    partner = match_terminals(tissue, one.point, other.point)
    count = int(first[-1])
    capsules = empty_capsules(count + (2 + PIECES) * len(partner))
    start = np.concatenate([tree.proximal for tree in trees])
    end = np.concatenate([tree.distal for tree in trees])
    radii = np.concatenate([tree_radii(tree) for tree in trees])
    fill_capsules(capsules[:count], start, end, radii)
    is_tip = np.concatenate([tree.children[:, 0] < 0 for tree in trees])
    chord = np.linalg.norm(one.point - other.point[partner], axis=1)
    rule = _rule(tissue, options, float(np.median(radii[is_tip])), chord)
    tip = np.concatenate([one.point, other.point])
    ahead = np.concatenate([one.direction, other.direction])
    stubs = capsules[count : count + len(tip)]
    fill_capsules(stubs, tip, tip + STUB * rule.radius * ahead, np.full(len(tip), rule.radius))
    cell = max(1.2 * float(np.cbrt(tissue.volume_mm3 / (2 * len(partner)))), 1e-6)
    index = empty_index(tissue.bounds, cell, 16 * len(capsules) + 4096, len(capsules))
    shapes = curve_shapes(options.seed, float(np.radians(options.kink_degrees)))
    web = Web(one, other, partner, rule, capsules, count, shapes, index)
    if not list_some(capsules, 0, len(capsules), index):
        web.reindex()
    return web


def _rule(tissue: Tissue, options: LoopOptions, typical: float, chord: FloatArray) -> Rule:
    radius, length = options.radius_ratio * typical, _LONGER * float(np.median(chord))
    if options.smallest_radius_mm is not None:
        # No curve is shorter than its chord; partners exchanged later may be nearer.
        radius, length = options.smallest_radius_mm, 0.9 * float(chord.min())
    return Rule(
        tissue.grid.arrays,
        options.clearance_mm,
        options.clearance_mm,
        options.clearance_ratio,
        radius,
        length,
        options.bend_to_radius,
        float(np.cos(np.radians(options.kink_degrees))),
        _COMFORT,
        options.weight_length,
        options.weight_tortuosity,
        options.weight_clearance,
        options.weight_volume,
    )


def tree_tips(tree: VesselTree, first: int) -> Tips:
    """The terminals of a tree whose segments are numbered from ``first`` on."""
    tip = np.flatnonzero(tree.children[:, 0] < 0)
    span = tree.distal[tip] - tree.proximal[tip]
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    parent = tree.parent[tip].astype(np.int64)
    above = np.where(parent >= 0, tree.parent[parent], -1).astype(np.int64)
    kin = np.full((len(tip), KIN), -1, dtype=np.int64)
    way = np.zeros((len(tip), KIN))
    kin[:, 0] = tip
    kin[:, 1], kin[:, 2] = parent, _sibling(tree, tip, parent)
    kin[:, 3] = above
    kin[:, 4] = np.where(parent >= 0, _sibling(tree, parent, above), -1)
    way[:, 1:3] = length[tip, None]
    way[:, 3:] = (length[tip] + length[parent])[:, None]
    return Tips(
        tree.distal[tip],
        span / length[tip, None],
        np.where(kin >= 0, kin + first, -1),
        way,
        length[tip],
        tree_radii(tree)[tip],
        np.zeros(len(tip)),
    )


def _sibling(tree: VesselTree, segment: IntArray, parent: IntArray) -> IntArray:
    """The other child of each parent, -1 where there is no parent."""
    other = tree.children[parent].sum(axis=1) - segment
    return np.where(parent >= 0, other, -1).astype(np.int64)


def _together(tips: list[Tips]) -> Tips:
    columns = ([getattr(t, f.name) for t in tips] for f in fields(Tips))
    return Tips(*(np.concatenate(column) for column in columns))


def _connections(web: Web, tree: int) -> VesselNetwork:
    """The curves as a network of their own, two nodes each."""
    count = len(web.radius)
    return VesselNetwork(
        nodes=web.curve[:, [0, -1]].reshape(-1, 3),
        vessel_nodes=np.arange(2 * count, dtype=np.int64).reshape(count, 2),
        kind=np.full(count, int(VesselKind.CONNECTION), dtype=np.int64),
        tree=np.full(count, tree, dtype=np.int64),
        offset=(PIECES + 1) * np.arange(count + 1, dtype=np.int64),
        points=web.curve.reshape(-1, 3),
        radius=np.repeat(web.radius, PIECES + 1),
    )


def _merged(
    network: VesselNetwork, nodes: int, web: Web, trees: list[VesselTree], arterial: int
) -> VesselNetwork:
    """Put the terminals' nodes in the place of the connections' own, from node ``nodes`` on."""
    # A tree's node 0 is its inlet, node i + 1 the end of its segment i.
    first = np.cumsum([0] + [len(tree.parent) + 1 for tree in trees])
    tips = [
        np.flatnonzero(tree.children[:, 0] < 0) + 1 + at
        for tree, at in zip(trees, first, strict=False)
    ]
    one, other = np.concatenate(tips[:arterial]), np.concatenate(tips[arterial:])
    ends = network.vessel_nodes.copy()
    ends[-len(one) :] = np.column_stack([one, other[web.partner]])
    at, points = network.nodes[:nodes].copy(), network.points.copy()
    at[one], at[other] = web.one.point, web.other.point
    # Straight vessels: two points each, at their nodes.
    straight = np.flatnonzero(np.diff(network.offset) == 2)
    for side in range(2):
        points[network.offset[straight] + side] = at[ends[straight, side]]
    return VesselNetwork(
        at, ends, network.kind, network.tree, network.offset, points, network.radius
    )
