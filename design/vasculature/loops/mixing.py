"""Join terminals of three or more trees, one of each, at common mixing nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.geometry.polyline import arc_lengths
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.forest import forest_to_network, joined_networks
from design.vasculature.loops.connect import Connections, Tips, empty_capsules, fill_capsules
from design.vasculature.loops.curves import KIN
from design.vasculature.loops.loops import (
    ClosedLoops,
    LoopOptions,
    close_loops,
    joined_at,
    match_tips,
    moved_tips,
    polylines,
    refuse_blocked,
    refuse_collisions,
    start_connections,
    tip_nodes,
    tree_ends,
)
from design.vasculature.tree import VesselTree
from kernels.arrays import FloatArray, IntArray

ATTEMPTS = ((2, 0.0), (4, 2.0), (8, 8.0), (16, 32.0))
"""Lengths of the first connections, over what a plain one needs, and least weights of clearance,
tried in turn: a mixing node in a narrow place takes no limb."""
POSITION_TOLERANCE = 1e-9
"""Part of a connection's length within which two places along it are one."""


def mix_trees(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    kinds: Sequence[VesselKind],
    options: LoopOptions | None = None,
    beside: VesselNetwork | None = None,
) -> ClosedLoops:
    """Join the terminals of three or more trees, one of each, at mixing nodes.

    The first artery and the first tree that drains (vein or lymph) are closed as in
    `close_loops`. Every further tree's terminals are joined to the middles of those connections,
    which become nodes: what several arteries bring mixes there, or one artery's flow is shared
    by several drains. The limbs of each tree's terminals have the same resistance among
    themselves, so that with trees of equal terminal pressures every node gets the same shares.
    Where limbs are blocked, all are joined anew, with longer first connections and more weight
    on clearance.

    Parameters
    ----------
    tissue : Tissue
    trees : sequence of VesselTree
        All with the same number of terminals; they don't touch (`grow_forest`).
    kinds : sequence of VesselKind
        Of each; at least one artery and one vein or lymph.
    options : LoopOptions, optional
        ``prune_part`` is taken as 0: no node is left without one of its limbs.
    beside : VesselNetwork, optional
        Vessels of others that the connections keep clear of; they aren't in the result.

    Returns
    -------
    ClosedLoops
        ``connections`` counts the mixing nodes.

    Raises
    ------
    GrowthError
        When there are fewer than three trees, no artery or nothing that drains, numbers of
        terminals differ, or limbs are blocked (with the count).
    NetworkError
        When the audit finds collisions (with the count).

    Examples
    --------
    Two arteries that both pervade the tissue, and a vein that drains what they mix::

        kinds = [VesselKind.ARTERY, VesselKind.ARTERY, VesselKind.VEIN]
        settings = GrowthOptions(terminals=40)
        trees = grow_forest(tissue, [settings, settings, RootSpec(settings, VesselKind.VEIN)])
        network = mix_trees(tissue, trees, kinds).network
    """
    options = options or LoopOptions()
    order = _order(trees, kinds)
    for parts, weight in ATTEMPTS:
        attempt = replace(options, weight_clearance=max(options.weight_clearance, weight))
        try:
            return _mix(tissue, trees, kinds, order, parts, attempt, beside)
        except GrowthError as error:
            refused = error
    raise refused


def _mix(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    kinds: Sequence[VesselKind],
    order: Sequence[int],
    parts: int,
    options: LoopOptions,
    beside: VesselNetwork | None,
) -> ClosedLoops:
    """Attempt it once: the first pair's connections, then each further tree's limbs."""
    ends, vessels = tree_ends(trees, beside)
    pair = [ends[order[0]], ends[order[1]]]
    partner = match_tips(tissue, pair[0], pair[1], options, parts)
    joins = start_connections(tissue, pair, partner, vessels, options)
    joins.join_all()
    refuse_blocked(joins, 0, options)
    half = _halve(joins)
    vessels, nodes = _mixing_nodes(joins, half)
    limbs: list[Connections] = []
    for number in order[2:]:
        partner = match_tips(tissue, ends[number], nodes, options)
        own = start_connections(tissue, [ends[number], nodes], partner, vessels, options)
        own.join_all()
        refuse_blocked(own, 0, options)
        vessels, nodes = _with_limbs(own, nodes)
        limbs.append(own)
    closed = _mixed(joins, half, limbs, trees, kinds, order)
    refuse_collisions(closed, options)
    return ClosedLoops(closed, len(partner), sum(one.shortened for one in [joins, *limbs]))


def _order(trees: Sequence[VesselTree], kinds: Sequence[VesselKind]) -> list[int]:
    """Return the trees in the order of joining: an artery, a drain, the others."""
    if len(trees) < 3 or len(kinds) != len(trees):
        raise GrowthError(
            f"{len(trees)} trees of {len(kinds)} kinds can't be mixed; give three or more trees "
            "and the kind of each (two are joined by close_loops)"
        )
    sizes = [int((tree.children[:, 0] < 0).sum()) for tree in trees]
    if len(set(sizes)) > 1:
        raise GrowthError(
            f"trees of {', '.join(map(str, sizes))} terminals can't be mixed; grow all with the "
            "same number"
        )
    artery = [n for n, kind in enumerate(kinds) if kind == VesselKind.ARTERY]
    drain = [n for n, kind in enumerate(kinds) if kind in (VesselKind.VEIN, VesselKind.LYMPH)]
    if not artery or not drain or len(artery) + len(drain) < len(kinds):
        raise GrowthError(
            "mixing takes arteries and veins or lymph, at least one of each that brings and that "
            f"drains; the kinds given are {', '.join(VesselKind(k).name.lower() for k in kinds)}"
        )
    return [artery[0], drain[0], *artery[1:], *drain[1:]]


def _halve(joins: Connections) -> list[int]:
    """Give each connection a point at half its resistance; return its index on the curve."""
    half = []
    whole = joins.limits.length / joins.limits.radius**4
    for n in range(len(joins.curve)):
        # What a shortened terminal lost is made up for on its own side.
        lost = joins.one.lost(n), joins.other.lost(int(joins.partner[n]))
        part = (0.5 * whole + lost[0]) / (whole + sum(lost))
        curve, at = _with_point(joins.curve[n], part)
        # Best in the place of the point nearest by: two short pieces would crowd the joint.
        nearest = int(np.argmin(np.linalg.norm(joins.curve[n][1:-1] - curve[at], axis=1))) + 1
        fewer, there = _with_point(np.delete(joins.curve[n], nearest, axis=0), part)
        if len(fewer) == len(joins.curve[n]) and there == nearest and joins.fits(n, fewer):
            curve, at = fewer, there
        joins.alter(n, curve)
        half.append(at)
    return half


def _with_point(curve: FloatArray, share: float) -> tuple[FloatArray, int]:
    """Return a polyline with a point at a share of its length, and that point's index."""
    arc = arc_lengths(curve)
    middle = share * arc[-1]
    nearest = int(np.argmin(np.abs(arc - middle)))
    if abs(arc[nearest] - middle) < POSITION_TOLERANCE * arc[-1]:
        return curve, nearest
    at = int(np.searchsorted(arc, middle))
    part = (middle - arc[at - 1]) / (arc[at] - arc[at - 1])
    place = curve[at - 1] + part * (curve[at] - curve[at - 1])
    return np.insert(curve, at, place, axis=0), at


def _mixing_nodes(joins: Connections, half: Sequence[int]) -> tuple[NDArray[np.void], Tips]:
    """Return all vessels, connections included, and the connections' middles as ends."""
    vessels, first = _all_vessels(joins)
    count = len(joins.curve)
    kin, way = np.full((count, KIN), -1, dtype=np.int64), np.zeros((count, KIN))
    point, ahead = np.empty((count, 3)), np.empty((count, 3))
    for n, (curve, h) in enumerate(zip(joins.curve, half, strict=True)):
        point[n] = curve[h]
        across = curve[h + 1] - curve[h - 1]
        ahead[n] = across / np.linalg.norm(across)
        at = int(first[n]) + h
        # The two pieces on either side, where there are as many, nearest first.
        kin[n, :4] = at - 1, at, at - 2 if h > 1 else -1, at + 1 if h < len(curve) - 2 else -1
        way[n, 2] = np.linalg.norm(curve[h] - curve[h - 1])
        way[n, 3] = np.linalg.norm(curve[h + 1] - curve[h])
        # A short connection's own terminals.
        kin[n, 4:6] = joins.one.kin[n, 0], joins.other.kin[joins.partner[n], 0]
        way[n, 4:6] = 0.5 * np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    none = np.zeros(count)
    return vessels, Tips(
        point, ahead, kin, way, none, joins.radius.copy(), none.copy(), mixing=True
    )


def _with_limbs(joins: Connections, nodes: Tips) -> tuple[NDArray[np.void], Tips]:
    """Return the same once a further tree's limbs are there: they are kin of their nodes."""
    vessels, first = _all_vessels(joins)
    for n, curve in enumerate(joins.curve):
        node, last = int(joins.partner[n]), int(first[n]) + len(curve) - 2
        free = np.flatnonzero(nodes.kin[node] < 0)[:2]
        ways = np.array([0.0, np.linalg.norm(curve[-1] - curve[-2])])
        nodes.kin[node, free] = np.array([last, last - 1])[: len(free)]
        nodes.way[node, free] = ways[: len(free)]
    return vessels, nodes


def _all_vessels(joins: Connections) -> tuple[NDArray[np.void], IntArray]:
    """Return fixed vessels, then the connections' pieces, and where each connection's begin."""
    size = np.array([len(curve) - 1 for curve in joins.curve])
    first = joins.fixed + np.concatenate([[0], np.cumsum(size)[:-1]])
    pieces = empty_capsules(int(size.sum()))
    start = np.concatenate([curve[:-1] for curve in joins.curve])
    end = np.concatenate([curve[1:] for curve in joins.curve])
    fill_capsules(pieces, start, end, np.repeat(joins.radius, size))
    return np.concatenate([joins.capsules[: joins.fixed], pieces]), first


def _mixed(
    joins: Connections,
    half: Sequence[int],
    limbs: Sequence[Connections],
    trees: Sequence[VesselTree],
    kinds: Sequence[VesselKind],
    order: Sequence[int],
) -> VesselNetwork:
    """Return trees, halves of the first connections, and limbs from trees to their middles."""
    grown = forest_to_network(trees, kinds)
    nodes = tip_nodes(trees)
    sides = [joins.one, joins.other, *(own.one for own in limbs)]
    grown = moved_tips(grown, np.concatenate([nodes[n] for n in order]), sides)
    count, base = len(joins.curve), len(grown.nodes)
    middle = base + np.arange(count)
    places = np.array([curve[h] for curve, h in zip(joins.curve, half, strict=True)])
    curves = [curve[: h + 1] for curve, h in zip(joins.curve, half, strict=True)]
    curves += [curve[h:] for curve, h in zip(joins.curve, half, strict=True)]
    ends = [
        np.column_stack([nodes[order[0]], middle]),
        np.column_stack([middle, nodes[order[1]][joins.partner]]),
    ]
    radius = [joins.radius, joins.radius]
    for number, own in zip(order[2:], limbs, strict=True):
        inward = kinds[number] == VesselKind.ARTERY
        pair = np.column_stack([nodes[number], middle[own.partner]])
        ends.append(pair if inward else pair[:, ::-1])
        curves += [curve if inward else curve[::-1] for curve in own.curve]
        radius.append(own.radius)
    lines = polylines(
        curves,
        np.concatenate(radius),
        np.concatenate(ends),
        np.concatenate([grown.nodes, places]),
        len(trees),
    )
    return joined_at(grown, lines)


Join = Literal["none", "loops", "mixing"]


@dataclass(frozen=True)
class JoinedTrees:
    """Trees of a forest that make one network.

    Attributes
    ----------
    trees : tuple of VesselTree
    kinds : tuple of VesselKind
    join : "none", "loops" or "mixing"
        How their terminals are joined: not at all, as `close_loops` or as `mix_trees`.
    """

    trees: tuple[VesselTree, ...]
    kinds: tuple[VesselKind, ...]
    join: Join

    def __post_init__(self) -> None:
        if len(self.trees) != len(self.kinds) or not self.trees:
            raise GrowthError(
                f"{len(self.trees)} trees of {len(self.kinds)} kinds make no network; give one "
                "tree or more, and the kind of each"
            )


def join_forest(
    tissue: Tissue,
    networks: Sequence[JoinedTrees],
    options: LoopOptions | None = None,
    beside: VesselNetwork | None = None,
    adjust: Callable[[ClosedLoops], ClosedLoops] | None = None,
) -> tuple[VesselNetwork, tuple[ClosedLoops, ...]]:
    """Join the trees of each network; connections keep clear of every other network.

    Parameters
    ----------
    tissue : Tissue
    networks : sequence of JoinedTrees
        Of one forest (`grow_forest`), so that no two trees touch.
    options : LoopOptions, optional
    beside : VesselNetwork, optional
        Vessels that were there before; they come last in the result.
    adjust : function of ClosedLoops, optional
        Applied to each network once it is joined; it may narrow vessels, not widen them.

    Returns
    -------
    VesselNetwork
        All networks, unconnected with each other. Trees are numbered as they come, network by
        network; then each network's connections have a number, then what was there before.
    tuple of ClosedLoops
        What became of each network.

    Raises
    ------
    GrowthError, NetworkError
        As `close_loops` and `mix_trees`, with the network's number; and when the audit of the
        whole finds collisions.
    """
    options = options or LoopOptions()
    done: list[ClosedLoops] = []
    for number, one in enumerate(networks):
        there = [each.network for each in done]
        there += [forest_to_network(each.trees, each.kinds) for each in networks[number + 1 :]]
        there += [] if beside is None else [beside]
        others = joined_networks(there) if there else None
        try:
            closed = _joined(tissue, one, options, others)
        except GrowthError as error:
            raise GrowthError(f"network {number} of {len(networks)}: {error}") from error
        done.append(closed if adjust is None else adjust(closed))
    whole = joined_networks(_numbered(networks, done, beside))
    refuse_collisions(whole, options)
    return whole, tuple(done)


def _joined(
    tissue: Tissue, one: JoinedTrees, options: LoopOptions, others: VesselNetwork | None
) -> ClosedLoops:
    if one.join == "mixing":
        return mix_trees(tissue, one.trees, one.kinds, options, others)
    if one.join == "none":
        return ClosedLoops(forest_to_network(one.trees, one.kinds), 0)
    strange = [kind for kind in one.kinds if kind not in (VesselKind.ARTERY, VesselKind.VEIN)]
    if strange:
        raise GrowthError(
            f"loops join arteries to veins, and {strange[0].name.lower()} is neither; give it a "
            "network of its own, or mix"
        )
    arteries, veins = (
        [tree for tree, kind in zip(one.trees, one.kinds, strict=True) if kind == side]
        for side in (VesselKind.ARTERY, VesselKind.VEIN)
    )
    closed = close_loops(tissue, arteries, veins, options, others)
    # The loops' trees are numbered arteries first.
    order = np.argsort([kind != VesselKind.ARTERY for kind in one.kinds], kind="stable")
    number = np.append(order, len(order))[closed.network.tree]
    return replace(closed, network=replace(closed.network, tree=number))


def _numbered(
    networks: Sequence[JoinedTrees], done: Sequence[ClosedLoops], beside: VesselNetwork | None
) -> list[VesselNetwork]:
    """Return the networks with distinct tree numbers."""
    first, count = 0, sum(len(one.trees) for one in networks)
    renumbered = []
    for one, closed in zip(networks, done, strict=True):
        own = first + np.arange(len(one.trees))
        joins = closed.connections > 0
        number = np.append(own, count)[closed.network.tree]
        renumbered.append(replace(closed.network, tree=number))
        first, count = first + len(own), count + joins
    if beside is not None:
        renumbered.append(replace(beside, tree=beside.tree - int(beside.tree.min()) + count))
    return renumbered
