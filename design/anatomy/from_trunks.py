"""Grow trees from trunk lines, one for each inlet, that share the tissue's flow by its volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.trunk_lines import TrunkLines, kept_at_depth, smooth_lines, trunk_from, without
from design.errors import GrowthError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.collisions.collide import collisions
from design.vasculature.growth.forest import RootSpec, grow_forest
from design.vasculature.growth.surroundings import Surroundings
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii

FloatArray = NDArray[np.float64]

DEPTH_MARGIN = 1.06
"""Depth of a trunk's axis over its radius, beside the clearance: radii rise a little while trees
grow and are curved."""

_ROUNDS = 4
_LIKELY = 2.0
_SPACING = 1.25
"""Room between trunks over what their radii and clearance ask for."""


@dataclass(frozen=True)
class TrunkPlan:
    """Where trunks run, before radii are known.

    Attributes
    ----------
    lines : TrunkLines
    shallow_mm : float
        Least depth of the trunks' axes.
    exactly : bool
        Whether trunks keep to their depth; else they may lie deeper.
    """

    lines: TrunkLines
    shallow_mm: float
    exactly: bool = True


def grow_from_plan(
    tissue: Tissue, plan: TrunkPlan, options: GrowthOptions
) -> tuple[tuple[VesselTree, ...], TrunkLines]:
    """Lay the trunks as deep as their radii ask for, and grow trees from them.

    Radii are known once the trees are grown: trunks that come out wider than was thought are laid
    deeper, and the trees grown again.

    Raises
    ------
    TissueError, GrowthError
        As `grow_forest`; and when trunks don't fit with the radii that they get.
    """
    radius = likely_radius(tissue, options)
    for _ in range(_ROUNDS):
        lines = laid(tissue, plan, radius, options)
        trees = grow_forest(tissue, roots_of(tissue, lines, radius, options))
        widest = 0.0
        for tree in trees:
            share = float(tree.terminals[0]) / options.terminals
            widest = max(widest, float(tree_radii(tree)[0]) / share ** (1 / options.murray_exponent))
        if 0.9 * radius < widest <= 1.02 * radius:
            return trees, lines
        radius = 1.01 * widest
    return trees, lines


def likely_radius(tissue: Tissue, options: GrowthOptions) -> float:
    """Radius of one root for the whole flow, before there is a tree, mm."""
    if options.smallest_radius_mm is not None:
        spread = options.terminal_spread or 1.5
        count = float(options.terminals)
        return options.smallest_radius_mm * spread * count ** (1.0 / options.murray_exponent)
    across = _LIKELY * float(np.cbrt(tissue.volume_mm3))
    flow = options.flow_ul_s(tissue.volume_mm3)
    resistance = 8.0 * options.viscosity_pa_s * across / pi
    return float((flow * resistance / options.pressure_drop_pa) ** 0.25)


def laid(
    tissue: Tissue, plan: TrunkPlan, radius_mm: float, options: GrowthOptions
) -> TrunkLines:
    """The plan's lines, smooth, at the depth that their radii ask for, and clear of each other."""
    lines = plan.lines
    while True:
        radius = radius_mm * lines.share ** (1.0 / options.murray_exponent)
        deep = np.maximum(DEPTH_MARGIN * radius + options.clearance_mm, plan.shallow_mm)
        keep = kept_at_depth(tissue, deep, lines.parent < 0, plan.exactly)
        smooth = smooth_lines(tissue, lines, keep)
        gone = _in_the_way(tissue, smooth, radius, options)
        if not gone.any():
            return smooth
        lines = without(lines, gone)


def _in_the_way(
    tissue: Tissue, lines: TrunkLines, radius: FloatArray, options: GrowthOptions
) -> NDArray[np.bool_]:
    """Nodes to be left away: of two trunks that are too near, the thinner and all below it."""
    piece = np.flatnonzero(lines.parent >= 0)
    network = VesselNetwork.from_segments(
        lines.points,
        np.column_stack([lines.parent[piece], piece]),
        radius[piece],
        np.full(len(piece), int(VesselKind.ARTERY)),
        lines.tree[piece],
    )
    clear = _SPACING * options.clearance_mm
    found = collisions(network, clear, _SPACING * options.clearance_ratio)
    gone = np.zeros(len(lines.parent), dtype=np.bool_)
    pairs = piece[found.vessels] if found.count else np.empty((0, 2), dtype=np.int64)
    thinner = np.where(radius[pairs[:, 0]] < radius[pairs[:, 1]], pairs[:, 0], pairs[:, 1])
    gone[thinner] = True
    inside = tissue.grid.capsule_inside(
        lines.points[lines.parent[piece]], lines.points[piece], radius[piece], options.clearance_mm
    )
    enters = lines.parent[lines.parent[piece]] < 0
    gone[piece[~inside & ~enters]] = True
    return _whole_branches(lines, gone)


def _whole_branches(lines: TrunkLines, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """All that lies below what is gone, and what of its branch is left above, too."""
    if not gone.any():
        return gone
    gone = gone.copy()
    count = lines.child_count()
    for i in range(len(gone)):
        if lines.parent[i] >= 0:
            gone[i] |= gone[lines.parent[i]]
    for i in range(len(gone) - 1, -1, -1):
        below = int(count[i])
        if below == 1 and lines.parent[i] >= 0:
            child = int(np.flatnonzero(lines.parent == i)[0])
            gone[i] |= gone[child]
    if gone[lines.parent < 0].any() or not (~gone & (lines.parent >= 0)).any():
        raise GrowthError(
            "the trunks don't fit with the radii they would have; ask for fewer terminals or a "
            "higher pressure_drop_mmhg"
        )
    return gone


def roots_of(
    tissue: Tissue, lines: TrunkLines, radius_mm: float, options: GrowthOptions
) -> list[RootSpec]:
    """One root for each tree of the lines, with its territory and its share of the terminals."""
    trees = np.unique(lines.tree)
    starts = [int(np.flatnonzero((lines.tree == t) & (lines.parent < 0))[0]) for t in trees]
    share = lines.share[starts] / lines.share[starts].sum()
    counts = np.floor(share * options.terminals).astype(np.int64)
    counts[np.argmax(share)] += options.terminals - int(counts.sum())
    found = []
    for tree, count in zip(trees.tolist(), counts.tolist(), strict=True):
        part = count / options.terminals
        radius = radius_mm * part ** (1.0 / options.murray_exponent)
        owns = None if len(trees) == 1 else _nearest_tree(lines, tree)
        found.append(
            RootSpec(
                replace(options, terminals=int(count)),
                VesselKind.ARTERY,
                trunk_from(lines, tree, radius),
                # The flow follows the terminals exactly, so that all have the same.
                Surroundings(owns=owns, share=part),
            )
        )
    return found


def _nearest_tree(lines: TrunkLines, tree: int) -> Callable[[FloatArray], NDArray[np.bool_]]:
    """Function that tells which points are nearest to a node of this tree."""
    index, number = cKDTree(lines.points), lines.tree

    def owns(points: FloatArray) -> NDArray[np.bool_]:
        mine: NDArray[np.bool_] = number[index.query(points)[1]] == tree
        return mine

    return owns
