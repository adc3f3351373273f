"""Round bends as far as there is room."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.anatomy.curves import STRAIGHT, Bends, Lines, curve_tree, main_children, turns
from design.anatomy.fitting.goal import FIT, Clearance, Misfits, Segments, Trees, reaching_out
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import BoolArray, FloatArray, IntArray


def misfits(
    tissue: Tissue, trees: Sequence[VesselTree], clearance: Clearance, joint_part: float = 1.0
) -> Misfits:
    """Find what doesn't fit; a root's segment may begin outside.

    Joints reach a little less far with more room: radii may still change. So do they with
    ``joint_part``, of their reach.
    """
    mm, ratio, room = clearance
    near = collisions(forest_to_network(trees), mm, ratio, room, min(joint_part, room**-0.5))
    return Misfits(near.vessels, reaching_out(tissue, Segments.of(trees), room * mm))


def curve_trees(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance: Clearance,
    least: float = STRAIGHT,
    narrow: float = STRAIGHT,
) -> tuple[Trees, Misfits]:
    """Round all bends and main lines; where something is in the way, less.

    Each curve reaches as far as its vessels allow; those of pieces that come too near to others,
    or out of the tissue, are halved until all fit.

    Parameters
    ----------
    least, narrow : float, rad
        Turns that stay as they are: of all vessels, and of those narrower than a quarter of their
        root's radius (thousands of them in fine pieces take minutes).

    Returns
    -------
    tuple of VesselTree
    Misfits
        What is left.
    """
    bends = [_first_bends(tree, least, narrow) for tree in trees]
    left: list[int] = []
    for n in range(FIT.halvings):
        curved = [curve_tree(*each) for each in zip(trees, bends, strict=True)]
        done = tuple(tree for tree, _ in curved)
        bad = misfits(tissue, done, clearance, FIT.joint)
        wider = [_wider(*each) for each in zip(trees, curved, strict=True)]
        turned = [(b.main != c) & ~b.forked for b, c in zip(bends, wider, strict=True)]
        if not bad.total and not any(some.any() for some in turned):
            break
        left.append(bad.total)
        if clearance.room > 1.0 and n >= FIT.stuck and left[-1] >= left[-1 - FIT.stuck]:
            break  # what is left is pushed apart next
        touched = np.zeros(sum(len(tree.parent) for tree in done), dtype=np.bool_)
        touched[bad.out] = touched[bad.pairs] = True
        first = 0
        for k, (tree, lines) in enumerate(curved):
            _shorten(trees[k], lines, touched[first : first + len(tree.parent)], bends[k].reach)
            # Where the curve itself makes the other child wider, both are alike.
            forked = bends[k].forked | (turned[k] & (n > 0))
            bends[k] = bends[k]._replace(main=wider[k], forked=forked)
            first += len(tree.parent)
    return done, misfits(tissue, done, clearance)


def _first_bends(tree: VesselTree, least: float, narrow: float) -> Bends:
    """Return curves that reach as far as they may."""
    radius, count = tree_radii(tree), len(tree.parent)
    turn = np.where(radius >= FIT.fine * radius[0], least, max(least, narrow))
    return Bends(np.ones(count), main_children(tree), np.zeros(count, dtype=np.bool_), turn)


def _shorten(tree: VesselTree, lines: Lines, bad: BoolArray, reach: FloatArray) -> None:
    """Lower the reach of the curves that bad pieces belong to, or lie between."""
    pieces = np.flatnonzero(bad) + 1
    segment = lines.origin[pieces]
    corners = np.concatenate([lines.corner[pieces], segment, tree.parent[segment]])
    corners = np.unique(corners[corners >= 0])
    reach[corners] = np.maximum(FIT.shorter * reach[corners], FIT.shortest)


def _wider(tree: VesselTree, curved: tuple[VesselTree, Lines]) -> IntArray:
    """Return the wider child of each segment once its tree is curved."""
    radius = np.zeros(len(tree.parent))
    radius[curved[1].origin[1:]] = tree_radii(curved[0])
    return main_children(tree, radius)


def kinks(trees: Sequence[VesselTree], of_root: float = FIT.wide) -> int:
    """Count the kinks of main lines in vessels wider than a part of their root's radius."""
    return sum(len(kinked(tree, of_root)) for tree in trees)


def kinked(tree: VesselTree, of_root: float = FIT.wide) -> IntArray:
    """Return segments at whose end a main line has a kink."""
    upper, turn = turns(tree)
    radius = tree_radii(tree)
    sharp = (turn > np.radians(FIT.kink)) & (radius[upper] > of_root * float(radius[0]))
    return np.asarray(upper[sharp])
