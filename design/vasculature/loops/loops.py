"""Join every arterial terminal to a venous one by a curved vessel, for closed loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching, min_weight_full_bipartite_matching
from scipy.spatial import KDTree

from design.errors import GrowthError, NetworkError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network, joined_networks
from design.vasculature.growth.index import empty_index
from design.vasculature.loops.connect import (
    STUB,
    Tips,
    Web,
    curve_shapes,
    empty_capsules,
    fill_capsules,
    join_tips,
    list_some,
    tree_tips,
)
from design.vasculature.loops.curves import PIECES, Rule
from design.vasculature.loops.loop_options import LoopOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray, IntArray

_COMFORT = 4.0
_LONGER = 1.15
"""Length of a typical curve over its chord."""


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
    routed : int
        Connections that go round something, as splines: no single cubic fitted.
    shortened : int
        Terminals drawn back to make room.
    pruned : int
        Terminals of a side that nothing joined; they were taken away, and the other side's they
        were matched to. Flows are no longer equal then: `design.hemodynamics.balance` mends it.
    """

    network: VesselNetwork
    connections: int
    routed: int = 0
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
    Each connection takes the cheapest of several cubic Bézier curves that fit; where none does,
    neighbours are laid anew and partners exchanged, then ways round are searched on a lattice and
    smoothed to splines, at last terminals are shortened (the connection makes up for the
    resistance lost), and a few are pruned. All pairs of the result, curves included, are audited.

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
        When the sides' terminals differ in number, or more connections find no way than may be
        pruned (with the count).
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
    web = open_web(tissue, tips, partner, vessels, options)
    web.lay_all()
    refuse_too_many(web, int(options.prune_part * len(partner)), options)
    closed = _closed(web, trees, kinds)
    refuse_collisions(closed, options)
    left = len(web.failed)
    return ClosedLoops(closed, len(web.radius) - left, int(web.routed.sum()), web.shortened, left)


def _as_list(trees: VesselTree | Sequence[VesselTree]) -> list[VesselTree]:
    return [trees] if isinstance(trees, VesselTree) else list(trees)


def tree_ends(
    trees: Sequence[VesselTree], beside: VesselNetwork | None = None
) -> tuple[list[Tips], NDArray[np.void]]:
    """Each tree's terminals, and all their vessels as capsules, those of others behind them."""
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
    """Match two sides' ends, those too near for a connection of so many ``parts`` avoided."""
    typical = float(np.median(one.radius))
    radius = options.smallest_radius_mm or options.radius_ratio * typical
    kept = max(options.clearance_mm, options.clearance_ratio * min(radius, typical))
    # Two pieces beside the ends and one between them, far enough apart.
    nearest = 2.0 * (radius + typical + kept) + 2.0 * radius + kept
    return match_terminals(tissue, one.point, other.point, parts * nearest)


def open_web(
    tissue: Tissue,
    tips: Sequence[Tips],
    partner: IntArray,
    vessels: NDArray[np.void],
    options: LoopOptions,
) -> Web:
    """A web with nothing laid yet between two sides' ends, among vessels that stay."""
    one, other = tips
    count, fixed = len(partner), len(vessels)
    capsules = np.concatenate([vessels, empty_capsules((2 + PIECES) * count)])
    chord = np.linalg.norm(one.point - other.point[partner], axis=1)
    typical = one if other.mixing else join_tips([one, other])
    rule = _rule(tissue, options, float(np.median(typical.radius)), chord)
    stubs = capsules[fixed : fixed + len(typical.point)]
    ahead = typical.point + STUB * rule.radius * typical.direction
    fill_capsules(stubs, typical.point, ahead, np.full(len(stubs), rule.radius))
    cell = max(1.2 * float(np.cbrt(tissue.volume_mm3 / (2 * count))), 1e-6)
    index = empty_index(tissue.bounds, cell, 16 * len(capsules) + 4096, len(capsules))
    shapes = curve_shapes(options.seed, float(np.radians(options.kink_degrees)))
    web = Web(one, other, partner, rule, tissue.bounds, capsules, fixed, shapes, index)
    if not list_some(capsules, 0, len(capsules), index):
        web.reindex()
    return web


def _rule(tissue: Tissue, options: LoopOptions, typical: float, chord: FloatArray) -> Rule:
    radius, length = options.radius_ratio * typical, _LONGER * float(np.median(chord))
    if options.smallest_radius_mm is not None:
        # No curve is shorter than its chord; partners exchanged later may be nearer, and then
        # have to take a longer way.
        radius, length = options.smallest_radius_mm, 0.9 * float(chord.min())
    return Rule(
        tissue.grid.arrays,
        options.clearance_mm,
        options.clearance_mm,
        options.clearance_ratio,
        radius,
        length,
        options.smallest_radius_mm or 0.0,
        options.bend_to_radius,
        float(np.cos(np.radians(options.kink_degrees))),
        _COMFORT,
        options.weight_length,
        options.weight_tortuosity,
        options.weight_clearance,
        options.weight_volume,
    )


def refuse_too_many(web: Web, allowed: int, options: LoopOptions) -> None:
    """Raise `GrowthError` when more connections found no way than ``allowed``."""
    left = web.failed
    if len(left) <= allowed:
        return
    place = web.one.point[left[0]]
    raise GrowthError(
        f"{len(left)} of {len(web.radius)} connections found no way with clearance "
        f"{options.clearance_mm:g} mm and bends of {options.bend_to_radius:g} radii "
        f"({allowed} may be pruned), one of them at "
        "({:.4g}, {:.4g}, {:.4g}) mm; ".format(*place)
        + "grow the trees with more clearance, or ask for thinner connections, tighter bends, "
        "less clearance or a larger prune_part"
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


def _closed(web: Web, trees: Sequence[VesselTree], kinds: Sequence[VesselKind]) -> VesselNetwork:
    """Trees and connections as one network, pruned of what wasn't joined."""
    grown = forest_to_network(trees, kinds)
    nodes = tip_nodes(trees)
    drains = np.array([kind != VesselKind.ARTERY for kind in kinds])
    one = np.concatenate([n for n, drain in zip(nodes, drains, strict=True) if not drain])
    other = np.concatenate([n for n, drain in zip(nodes, drains, strict=True) if drain])
    grown = moved_tips(grown, np.append(one, other), [web.one, web.other])
    laid = np.flatnonzero(web.radius > 0)
    ends = np.column_stack([one, other[web.partner]])[laid]
    lines = polylines([web.curve[n] for n in laid], web.radius[laid], ends, grown.nodes, len(trees))
    return pruned(joined_at(grown, lines))


def tip_nodes(trees: Sequence[VesselTree]) -> list[IntArray]:
    """Node of each terminal of each tree in `forest_to_network`'s numbering."""
    # A tree's node 0 is its inlet, node i + 1 the end of its segment i.
    first = np.cumsum([0] + [len(tree.parent) + 1 for tree in trees])
    return [
        np.flatnonzero(tree.children[:, 0] < 0) + 1 + at
        for tree, at in zip(trees, first, strict=False)
    ]


def moved_tips(network: VesselNetwork, node: IntArray, tips: Sequence[Tips]) -> VesselNetwork:
    """A network of straight vessels with its terminals where they were drawn back to."""
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
    """Connections between ``nodes`` as a network; None where there are none."""
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
    """A network and vessels between its own nodes (``more`` lists the same or further nodes)."""
    if more is None:
        return network
    both = joined_networks([network, more])
    ends = both.vessel_nodes.copy()
    ends[network.vessel_count :] -= len(network.nodes)
    return VesselNetwork(
        more.nodes, ends, both.kind, both.tree, both.offset, both.points, both.radius
    )


def pruned(network: VesselNetwork) -> VesselNetwork:
    """The network without vessels of trees that lead nowhere, nodes numbered anew."""
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


# Match arterial with venous terminals one to one, with least total distance.

NEAREST = 12
"""Candidates of each terminal at first; doubled until all can be matched."""
TOO_NEAR = 4.0
"""Weight of what a pair lacks of the least distance."""
ACROSS = 4.0
"""Factor on the distance of two terminals between which the straight way leaves the tissue."""


def match_terminals(
    tissue: Tissue, one: FloatArray, other: FloatArray, nearest_mm: float = 0.0
) -> IntArray:
    """Match points one to one with the least sum of distances, within sparse candidates.

    Squared distances would keep the longest shorter, but where one side is denser than the other
    they make all connections in between long, which then are in each other's way. A pair nearer
    than ``nearest_mm`` counts for that and `TOO_NEAR` times what it lacks: no curve that is wide
    enough turns in so little room. Where the straight connection leaves the tissue, a pair counts
    `ACROSS` times its distance.

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
    nearest = NEAREST
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
    apart = np.linalg.norm(end - start, axis=1)
    apart = np.where(apart < nearest_mm, nearest_mm + TOO_NEAR * (nearest_mm - apart), apart)
    leaves = ~tissue.grid.capsule_inside(start, end, np.zeros(len(start)))
    # Explicit zeros would read as missing candidates.
    cost = np.maximum(apart * np.where(leaves, ACROSS, 1.0), 1e-9)
    return csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
