"""Join every arterial terminal to a venous one by a curved vessel, for closed loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching, min_weight_full_bipartite_matching
from scipy.spatial import KDTree

from design.errors import GrowthError, NetworkError, NoRoomError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network, joined_networks
from design.vasculature.growth.kernels.index import empty_index
from design.vasculature.loops.connect import (
    PLACES,
    SEARCH,
    Connections,
    Tips,
    curve_shapes,
    empty_capsules,
    fill_capsules,
    join_tips,
    list_capsules,
    tree_tips,
)
from design.vasculature.loops.curves import ConnectionLimits
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray, IntArray


class LoopSettings(NamedTuple):
    """How terminals are matched, and what their connections are compared with."""

    candidates: int = 12
    """Partners considered for each terminal at first; doubled until all can be matched."""
    near_weight: float = 4.0
    """Weight of what a pair lacks of the least distance."""
    outside_factor: float = 4.0
    """Factor on a distance where the straight way leaves the tissue."""
    ample_gap: float = 4.0
    """Gap over a connection's radius beyond which a larger one costs no less."""
    length_factor: float = 1.15
    """Length of a typical curve over its chord."""
    far_partners: float = 3.0
    """Median distance of partners over that of neighbours, from which a refusal names it."""


LOOPS = LoopSettings()


@dataclass(frozen=True)
class LoopOptions:
    """Options of joining terminals.

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
    prune_part : float
        Part of the terminals that may be pruned, in pairs, where nothing joins them; more is an
        error.
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
    prune_part: float = 0.01
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
    ("prune_part", 0.0, 0.5),
    ("weight_length", 0.0, 1e3),
    ("weight_tortuosity", 0.0, 1e3),
    ("weight_clearance", 0.0, 1e3),
    ("weight_volume", 0.0, 1e3),
)


@dataclass(frozen=True)
class ClosedLoops:
    """A closed network, and what it took.

    Attributes
    ----------
    network : VesselNetwork
        Arteries, veins (flow towards their roots) and connections (each a polyline; tree numbers
        go on after the trees').
    connections : int
        Terminals of a side that are joined.
    shortened : int
        Terminals shortened so that a curve fits.
    pruned : int
        Pairs of terminals that nothing joined and that were taken away. Flows are no longer equal
        then: `design.hemodynamics.balance` mends it.
    """

    network: VesselNetwork
    connections: int
    shortened: int = 0
    pruned: int = 0


def close_loops(
    tissue: Tissue,
    arterial: VesselTree | Sequence[VesselTree],
    venous: VesselTree | Sequence[VesselTree],
    options: LoopOptions | None = None,
    beside: VesselNetwork | None = None,
) -> ClosedLoops:
    """Join every arterial terminal to a venous one by a smooth curve in the tissue.

    Terminals are matched with the least sum of distances, pairs too near for a curve avoided.
    Each connection takes the cheapest of several cubic Bézier curves that fit. Where none does,
    partners are exchanged with neighbours, then terminals are shortened (the connection makes up
    for the resistance lost), and a few pairs may be pruned. All pairs of vessels of the result,
    curves included, are audited.

    Parameters
    ----------
    tissue : Tissue
    arterial, venous : VesselTree or sequence of VesselTree
        As many terminals on one side as on the other; trees that don't touch (`grow_forest`).
        Several of a side mix: a terminal may be joined to any tree of the other.
    options : LoopOptions, optional
    beside : VesselNetwork, optional
        Vessels of others that the connections keep clear of; they aren't in the result.

    Returns
    -------
    ClosedLoops

    Raises
    ------
    GrowthError
        When the sides' terminals differ in number, or more pairs are blocked than may be pruned
        (with the count).
    NetworkError
        When the audit finds collisions (with the count), between the trees given or else.
    """
    options = options or LoopOptions()
    sides = [_as_list(arterial), _as_list(venous)]
    kinds = [VesselKind.ARTERY] * len(sides[0]) + [VesselKind.VEIN] * len(sides[1])
    trees = [*sides[0], *sides[1]]
    ends, vessels = tree_ends(trees, beside)
    tips = [join_tips(ends[: len(sides[0])]), join_tips(ends[len(sides[0]) :])]
    partner = match_tips(tissue, tips[0], tips[1], options)
    joins = start_connections(tissue, tips, partner, vessels, options)
    joins.join_all()
    refuse_blocked(joins, int(options.prune_part * len(partner)), options)
    closed = _closed(joins, trees, kinds)
    refuse_collisions(closed, options)
    pruned_pairs = len(joins.blocked)
    return ClosedLoops(closed, len(partner) - pruned_pairs, joins.shortened, pruned_pairs)


def _as_list(trees: VesselTree | Sequence[VesselTree]) -> list[VesselTree]:
    return [trees] if isinstance(trees, VesselTree) else list(trees)


def tree_ends(
    trees: Sequence[VesselTree], beside: VesselNetwork | None = None
) -> tuple[list[Tips], NDArray[np.void]]:
    """Return each tree's terminals, and all vessels as capsules, those of others last."""
    first = np.cumsum([0] + [len(tree.parent) for tree in trees])
    tips = [tree_tips(tree, int(at)) for tree, at in zip(trees, first, strict=False)]
    capsules = empty_capsules(int(first[-1]))
    start = np.concatenate([tree.proximal for tree in trees])
    end = np.concatenate([tree.distal for tree in trees])
    fill_capsules(capsules, start, end, np.concatenate([tree_radii(tree) for tree in trees]))
    if beside is None:
        return tips, capsules
    start, end, r0, r1, _ = beside.pieces()
    others = empty_capsules(len(start))
    fill_capsules(others, start, end, np.maximum(r0, r1))
    return tips, np.concatenate([capsules, others])


def match_tips(
    tissue: Tissue, one: Tips, other: Tips, options: LoopOptions, parts: int = 1
) -> IntArray:
    """Match two sides' ends; avoid pairs too near for a connection of ``parts`` parts."""
    typical = float(np.median(one.radius))
    radius = options.smallest_radius_mm or options.radius_ratio * typical
    kept = max(options.clearance_mm, options.clearance_ratio * min(radius, typical))
    # Two pieces beside the ends, and one between that separates them.
    nearest = 2.0 * (radius + typical + kept) + 2.0 * radius + kept
    return match_terminals(tissue, one.point, other.point, parts * nearest)


def start_connections(
    tissue: Tissue,
    tips: Sequence[Tips],
    partner: IntArray,
    vessels: NDArray[np.void],
    options: LoopOptions,
) -> Connections:
    """Return the connections of two sides' ends, none joined yet, among vessels that stay."""
    one, other = tips
    count, fixed = len(partner), len(vessels)
    capsules = np.concatenate([vessels, empty_capsules((2 + PLACES) * count)])
    chord = np.linalg.norm(one.point - other.point[partner], axis=1)
    typical = one if other.mixing else join_tips([one, other])
    limits = _limits(tissue, options, float(np.median(typical.radius)), chord)
    stubs = capsules[fixed : fixed + len(typical.point)]
    ahead = typical.point + SEARCH.free_length * limits.radius * typical.direction
    fill_capsules(stubs, typical.point, ahead, np.full(len(stubs), limits.radius))
    cell = max(1.2 * float(np.cbrt(tissue.volume_mm3 / (2 * count))), 1e-6)
    index = empty_index(tissue.bounds, cell, 16 * len(capsules) + 4096, len(capsules))
    shapes = curve_shapes(options.seed, float(np.radians(options.kink_degrees)))
    joins = Connections(one, other, partner, limits, tissue.bounds, capsules, fixed, shapes, index)
    if not list_capsules(capsules, 0, len(capsules), index):
        joins.reindex()
    return joins


def _limits(
    tissue: Tissue, options: LoopOptions, typical: float, chord: FloatArray
) -> ConnectionLimits:
    radius, length = options.radius_ratio * typical, LOOPS.length_factor * float(np.median(chord))
    if options.smallest_radius_mm is not None:
        # No curve is shorter than its chord; partners exchanged later may be nearer, and then
        # have to take a longer curve.
        radius, length = options.smallest_radius_mm, 0.9 * float(chord.min())
    return ConnectionLimits(
        tissue.grid.arrays,
        options.clearance_mm,
        options.clearance_mm,
        options.clearance_ratio,
        radius,
        length,
        options.smallest_radius_mm or 0.0,
        options.bend_to_radius,
        float(np.cos(np.radians(options.kink_degrees))),
        LOOPS.ample_gap,
        options.weight_length,
        options.weight_tortuosity,
        options.weight_clearance,
        options.weight_volume,
    )


def refuse_blocked(joins: Connections, allowed: int, options: LoopOptions) -> None:
    """Raise `GrowthError` when more than ``allowed`` pairs are blocked."""
    blocked = joins.blocked
    if len(blocked) <= allowed:
        return
    place = joins.one.point[blocked[0]]
    raise NoRoomError(
        f"{len(blocked)} of {len(joins.radius)} connections found no path with clearance "
        f"{options.clearance_mm:g} mm and bends of {options.bend_to_radius:g} radii "
        f"({allowed} may be pruned), one of them at "
        "({:.4g}, {:.4g}, {:.4g}) mm".format(*place),
        "take another clearance_mm or, of connections, a smaller radius_ratio or bend_to_radius, "
        "or a larger most_pruned_percent" + _far_partners(joins),
    )


def _far_partners(joins: Connections) -> str:
    """Return a remedy where partners lie farther apart than terminals of a side do, else ""."""
    here, there = joins.one.point, joins.other.point
    if len(here) < 2:
        return ""
    chord = float(np.median(np.linalg.norm(here - there[joins.partner], axis=1)))
    spacing = float(np.median(KDTree(here).query(here, k=2)[0][:, 1]))
    if chord < LOOPS.far_partners * spacing:
        return ""
    return (
        f"; partners lie {chord:.3g} mm apart in the median, and neighbours of a side "
        f"{spacing:.3g} mm: of a forest give territories by_network or whole, as divided ones "
        "lead arteries and veins to different places, or fewer terminals"
    )


def refuse_collisions(network: VesselNetwork, options: LoopOptions) -> None:
    """Raise `NetworkError` when vessels of a finished network collide."""
    pairs = collisions(network, options.clearance_mm, options.clearance_ratio)
    if pairs.count:
        raise NetworkError(
            f"the audit found {pairs.count} colliding pairs, first vessels "
            f"{pairs.vessels[0, 0]} and {pairs.vessels[0, 1]} with a gap of "
            f"{pairs.gap_mm[0]:.3g} mm; grow the trees as one forest with at least the loops' "
            "clearance"
        )


def _closed(
    joins: Connections, trees: Sequence[VesselTree], kinds: Sequence[VesselKind]
) -> VesselNetwork:
    """Return trees and connections as one network, without what wasn't joined."""
    grown = forest_to_network(trees, kinds)
    nodes = tip_nodes(trees)
    drains = np.array([kind != VesselKind.ARTERY for kind in kinds])
    one = np.concatenate([n for n, drain in zip(nodes, drains, strict=True) if not drain])
    other = np.concatenate([n for n, drain in zip(nodes, drains, strict=True) if drain])
    grown = moved_tips(grown, np.append(one, other), [joins.one, joins.other])
    joined = np.flatnonzero(joins.radius > 0)
    ends = np.column_stack([one, other[joins.partner]])[joined]
    lines = polylines(
        [joins.curve[n] for n in joined], joins.radius[joined], ends, grown.nodes, len(trees)
    )
    return pruned(joined_at(grown, lines))


def tip_nodes(trees: Sequence[VesselTree]) -> list[IntArray]:
    """Return each tree's terminals' nodes in `forest_to_network`'s numbering."""
    # A tree's node 0 is its inlet, node i + 1 the end of its segment i.
    first = np.cumsum([0] + [len(tree.parent) + 1 for tree in trees])
    return [
        np.flatnonzero(tree.children[:, 0] < 0) + 1 + at
        for tree, at in zip(trees, first, strict=False)
    ]


def moved_tips(network: VesselNetwork, node: IntArray, tips: Sequence[Tips]) -> VesselNetwork:
    """Return a network of straight vessels with its terminals as shortened."""
    at = network.nodes.copy()
    at[node] = np.concatenate([side.point for side in tips])
    return VesselNetwork.from_segments(
        at, network.vessel_nodes, network.radius[::2], network.kind, network.tree
    )


def polylines(
    curves: Sequence[FloatArray],
    radius: FloatArray,
    ends: IntArray,
    nodes: FloatArray,
    tree: int,
) -> VesselNetwork | None:
    """Return connections between ``nodes`` as a network; None where there are none."""
    if len(curves) == 0:
        return None
    size = np.array([len(curve) for curve in curves])
    return VesselNetwork(
        nodes=nodes,
        vessel_nodes=ends,
        kind=np.full(len(curves), int(VesselKind.CONNECTION), dtype=np.int64),
        tree=np.full(len(curves), tree, dtype=np.int64),
        offset=np.concatenate([[0], np.cumsum(size)]),
        points=np.concatenate(list(curves)),
        radius=np.repeat(radius, size),
    )


def joined_at(network: VesselNetwork, more: VesselNetwork | None) -> VesselNetwork:
    """Return a network with vessels between its nodes (``more`` has the same or more nodes)."""
    if more is None:
        return network
    both = joined_networks([network, more])
    ends = both.vessel_nodes.copy()
    ends[network.vessel_count :] -= len(network.nodes)
    return VesselNetwork(
        more.nodes, ends, both.kind, both.tree, both.offset, both.points, both.radius
    )


def pruned(network: VesselNetwork) -> VesselNetwork:
    """Return the network without vessels of trees that lead nowhere, nodes numbered anew."""
    keep = np.ones(network.vessel_count, dtype=bool)
    ends = network.vessel_nodes
    inward = np.isin(network.kind, (VesselKind.VEIN, VesselKind.LYMPH))
    outward = network.kind == VesselKind.ARTERY
    while True:
        begins = np.bincount(ends[keep, 0], minlength=len(network.nodes))
        stops = np.bincount(ends[keep, 1], minlength=len(network.nodes))
        blind = keep & ((outward & (begins[ends[:, 1]] == 0)) | (inward & (stops[ends[:, 0]] == 0)))
        if not blind.any():
            break
        keep &= ~blind
    if keep.all():
        return network
    point = np.repeat(keep, np.diff(network.offset))
    used, number = np.unique(ends[keep], return_inverse=True)
    return VesselNetwork(
        network.nodes[used],
        number.reshape(-1, 2).astype(np.int64),
        network.kind[keep],
        network.tree[keep],
        np.concatenate([[0], np.cumsum(np.diff(network.offset)[keep])]),
        network.points[point],
        network.radius[point],
    )


def match_terminals(
    tissue: Tissue, one: FloatArray, other: FloatArray, nearest_mm: float = 0.0
) -> IntArray:
    """Match points one to one with the least sum of distances, within sparse candidates.

    Squared distances would keep the longest shorter, but where one side is denser than the other
    they make all connections in between long, which then are in each other's way. A pair nearer
    than ``nearest_mm`` counts for that and `near_weight` times what it lacks: no curve that is wide
    enough turns in so little room. Where the straight connection leaves the tissue, a pair counts
    `outside_factor` times its distance (`LoopSettings`).

    Each point's candidates are its nearest of the other side, and it theirs.

    Parameters
    ----------
    one, other : (n, 3) float64, mm
    nearest_mm : float
        Least distance of a pair that isn't avoided.

    Returns
    -------
    (n,) int64
        Index into ``other`` for each of ``one``.

    Raises
    ------
    GrowthError
        When the numbers differ.
    """
    count = len(one)
    if len(other) != count:
        raise GrowthError(
            f"{count} arterial terminals can't be matched to {len(other)} venous ones; grow both "
            "sides with the same number of terminals"
        )
    nearest = LOOPS.candidates
    while True:
        weight = _candidates(tissue, one, other, min(nearest, count), nearest_mm)
        # Asked first: without a full matching the search for the cheapest runs for minutes.
        if np.any(maximum_bipartite_matching(weight, "column") < 0):
            nearest *= 2
            continue
        rows, columns = min_weight_full_bipartite_matching(weight)
        partner = np.empty(count, dtype=np.int64)
        partner[rows] = columns
        return partner


def _candidates(
    tissue: Tissue, one: FloatArray, other: FloatArray, nearest: int, nearest_mm: float
) -> csr_array:
    count = len(one)
    every = np.repeat(np.arange(count), nearest)
    _, forth = KDTree(other).query(one, k=nearest)
    _, back = KDTree(one).query(other, k=nearest)
    pairs = np.concatenate(
        [np.column_stack([every, np.ravel(forth)]), np.column_stack([np.ravel(back), every])]
    )
    pairs = np.unique(pairs, axis=0)
    start, end = one[pairs[:, 0]], other[pairs[:, 1]]
    distance = np.linalg.norm(end - start, axis=1)
    distance = np.where(
        distance < nearest_mm, nearest_mm + LOOPS.near_weight * (nearest_mm - distance), distance
    )
    leaves = ~tissue.grid.capsule_inside(start, end, np.zeros(len(start)))
    # Explicit zeros would read as missing candidates.
    cost = np.maximum(distance * np.where(leaves, LOOPS.outside_factor, 1.0), 1e-9)
    return csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
