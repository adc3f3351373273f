"""Join a forest's trees to networks: closed loops, mixing networks, trees that stand alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from design.errors import GrowthError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.forest import forest_to_network, joined_networks
from design.vasculature.loops.loop_options import LoopOptions
from design.vasculature.loops.loops import ClosedLoops, close_loops, refuse_collisions
from design.vasculature.loops.mixing import mix_trees
from design.vasculature.tree import VesselTree

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
    """The networks with numbers of trees that are told apart."""
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
