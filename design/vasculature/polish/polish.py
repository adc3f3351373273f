"""Lower a grown tree's cost: relax all its branch points, then graft branches elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.collisions.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.polish.cost import tree_volume
from design.vasculature.polish.options import PolishOptions
from design.vasculature.polish.tree_polish import Bench
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii


@dataclass(frozen=True)
class Faults:
    """What is wrong with a tree in its tissue.

    Attributes
    ----------
    collisions : int
        Pairs as `design.vasculature.collisions` counts them.
    joint_overlaps : int
        Pairs as near within one joint.
    outside : int
        Segments, the stem apart, whose capsule isn't in the tissue.
    short : int
        Segments shorter than the least length over their radius.
    """

    collisions: int
    joint_overlaps: int
    outside: int
    short: int

    def no_worse_than(self, other: Faults) -> bool:
        """Whether there are no more collisions, joint overlaps or segments outside."""
        return (
            self.collisions <= other.collisions
            and self.joint_overlaps <= other.joint_overlaps
            and self.outside <= other.outside
        )


@dataclass(frozen=True)
class PolishedTree:
    """A polished tree, and what it took.

    Attributes
    ----------
    tree : VesselTree
        The tree that came in where nothing better was found.
    volume_before, volume_after : float, mm³
    cost_ratio : float
        Cost after over cost before; the volume's ratio for exponents 1 and 2.
    relaxed_ratio : float
        The same after the first relaxation, before any graft.
    node_moves, graft_moves : int
        Kept moves of branch points and of branches.
    rejected : int
        Moves undone because what they left couldn't be repaired.
    faults_before, faults_after : Faults
    """

    tree: VesselTree
    volume_before: float
    volume_after: float
    cost_ratio: float
    relaxed_ratio: float
    node_moves: int
    graft_moves: int
    rejected: int
    faults_before: Faults
    faults_after: Faults


def find_faults(
    tissue: Tissue,
    tree: VesselTree,
    options: PolishOptions,
    others: Sequence[VesselTree] = (),
) -> Faults:
    """Audit a tree with its exact radii; collisions with other trees count, and theirs."""
    radius = tree_radii(tree)
    network = forest_to_network([tree, *others])
    pairs = collisions(network, options.clearance_mm, options.clearance_ratio)
    inside: NDArray[np.bool_] = tissue.grid.capsule_inside(
        tree.proximal[1:], tree.distal[1:], radius[1:], options.clearance_mm
    )
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    short = length < options.length_to_radius * radius
    return Faults(pairs.count, len(pairs.joint_pieces), int((~inside).sum()), int(short.sum()))


def polish_forest(
    tissue: Tissue, trees: Sequence[VesselTree], options: PolishOptions
) -> tuple[PolishedTree, ...]:
    """Polish trees of one tissue in turn, each clear of the others as they stand.

    Parameters
    ----------
    trees : sequence of VesselTree
        As `grow_forest` returns them.

    Returns
    -------
    tuple of PolishedTree
        In the order given.

    Raises
    ------
    GrowthError
        As `polish`.
    """
    standing = list(trees)
    polished = []
    for number, tree in enumerate(trees):
        others = standing[:number] + standing[number + 1 :]
        polished.append(polish(tissue, tree, options, others))
        standing[number] = polished[-1].tree
    return tuple(polished)


def polish(
    tissue: Tissue,
    tree: VesselTree,
    options: PolishOptions,
    others: Sequence[VesselTree] = (),
) -> PolishedTree:
    """Lower a tree's cost by moving branch points and branches; terminals and stem stay.

    Branch points move, one after another in sweeps, towards the weighted Fermat point of their
    three neighbours; the weights are the exact gradient of the whole tree's cost
    (`design.vasculature.polish.cost`). Branches are cut off and grafted on nearer or cheaper
    segments, as in Guy et al. 2019 (doi 10.1109/TBME.2019.2942313) and Jessen et al. 2024
    (arXiv 2410.06002). A move is made only when its vessels fit and the exact cost falls, or, of a
    graft in a warm round, rises by no more than the round's heat. After each sweep all pairs are
    audited with the true radii; what grew too wide is pushed aside or grafted elsewhere, and a
    sweep that can't be repaired is undone, half of it tried instead. What ends dearer than the
    first relaxation isn't kept.

    Parameters
    ----------
    tissue : Tissue
    tree : VesselTree
        Its flow, pressure drop, viscosity and Murray exponent are held.
    options : PolishOptions
    others : sequence of VesselTree
        Other trees in the tissue, which stay as they are and are kept clear of.

    Returns
    -------
    PolishedTree
        Never dearer than what came in, nor with more collisions, joint overlaps or segments
        outside. Same input, same bytes, whatever the number of threads. The smallest radius isn't
        held: scale with `scaled_to_smallest_radius` and check anew. A penalty isn't known here.

    Raises
    ------
    GrowthError
        When the tree grew from a given trunk.
    """
    if tree.given.any():
        raise GrowthError(
            "a tree grown from a given trunk can't be polished: that would move the trunk; "
            "polish a tree grown from its root"
        )
    before = find_faults(tissue, tree, options, others)
    bench = Bench.open(tissue, tree, options, others)
    cost = bench.cost
    relaxed = bench.run()
    done = bench.tree()
    after = find_faults(tissue, done, options, others)
    ratio = bench.cost / cost
    if not after.no_worse_than(before) or not ratio < 1.0:
        done, after, ratio, relaxed = tree, before, 1.0, 1.0
    return PolishedTree(
        tree=done,
        volume_before=tree_volume(tree),
        volume_after=tree_volume(done),
        cost_ratio=ratio,
        relaxed_ratio=relaxed,
        node_moves=bench.node_moves,
        graft_moves=bench.graft_moves,
        rejected=bench.rejected,
        faults_before=before,
        faults_after=after,
    )
