"""Lay trunks as deep as their radii need, and grow a vessel tree from each inlet's trunk."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.clear_trunks import clear_trunks
from design.anatomy.trunk_lines import (
    TrunkLines,
    kept_at_depth,
    smooth_lines,
    thinned,
    trunk_from,
)
from design.errors import WideTrunkError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.growth.forest import RootSpec, grow_forest, likely_radius
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.tree import SPREADS
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray

DEPTH_MARGIN = 1.03
"""Depth of a trunk's axis over its radius, beside the clearance: radii rise a little while trees
grow and are curved."""

RADIUS_MARGIN = 1.05
"""Radii that trunks are laid for, over those that they got last time."""

STRAIGHTER = 0.12
"""How far trunk lines may be straightened, over their radius; curves come last."""

WIDER = 1.15
"""See `TrunkPlan`."""

_ROUNDS = 2

_LATER = 60
"""Rounds in which branches may fork later; some ten do."""


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
    wider : float
        Radii by which trunks are kept clear of each other, over those they are laid for.
    keep : function of (n, 3) to (n, 3), optional
        Brings nodes back to a zone, after they were brought to their depth.
    branches : function of lines and radii to both, optional
        Adds branches that leave the laid trunks.
    branches_are_trunks : bool
        Whether they count as trunks in the grown trees.
    widest_branch : float
        See `Trunk`, where they don't.
    each : tuple of GrowthOptions
        Of each tree, where all of them serve the whole tissue; else they share it.
    tries : int
        Growths from the same trunks at most, where one gets stuck.
    main : frozenset of bytes
        Nodes, as bytes, that stay where others are in their way, however thin they are.
    lost : function of lines and radii, optional
        What is to be raised where the laid trunks lack a branch that the organ needs.
    """

    lines: TrunkLines
    shallow_mm: float
    exactly: bool = True
    wider: float = WIDER
    keep: Callable[[FloatArray], FloatArray] | None = None
    branches: Callable[[TrunkLines, FloatArray], tuple[TrunkLines, FloatArray]] | None = None
    branches_are_trunks: bool = True
    widest_branch: float = np.inf
    each: tuple[GrowthOptions, ...] = ()
    tries: int = len(SPREADS)
    main: frozenset[bytes] = frozenset()
    lost: Callable[[TrunkLines, FloatArray], WideTrunkError | None] | None = None


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
    lines = plan.lines
    wide = np.array([likely_radius(tissue, one) for one in plan.each or (options,)])
    root = wide[lines.tree] if plan.each else wide[0]
    radius = root * lines.share ** (1 / options.murray_exponent)
    for left in range(_ROUNDS - 1, -1, -1):
        smooth, lines, radius = laid(tissue, plan, lines, radius, options)
        lost = plan.lost(smooth, radius) if plan.lost else None
        if lost is not None:
            raise lost
        whole, wide = plan.branches(smooth, radius) if plan.branches else (smooth, radius)
        thin = thinned(whole, STRAIGHTER * wide)
        roots = _pervading(thin, wide, whole, plan) if plan.each else roots_of(thin, wide, options)
        if not plan.branches_are_trunks:
            roots = [kept_narrow(root, smooth.points, plan.widest_branch) for root in roots]
        trees = grow_forest(tissue, roots, attempts=plan.tries)
        grown = trunk_radii(smooth, trees)
        if left == 0 or (grown <= radius).all():
            break
        # Which trunk feeds what differs a little from one growth to the next.
        radius = RADIUS_MARGIN * grown
    return trees, smooth


def kept_narrow(root: RootSpec, trunks: FloatArray, widest: float) -> RootSpec:
    """The root, with all that doesn't end at a node of trunks (n, 3) planned as branches."""
    assert root.trunk is not None
    nodes = {place.tobytes() for place in trunks}
    planned = np.array([place.tobytes() not in nodes for place in root.trunk.distal])
    trunk = replace(root.trunk, planned=planned, widest_branch=widest)
    return replace(root, trunk=trunk)


def trunk_radii(lines: TrunkLines, trees: Sequence[VesselTree]) -> FloatArray:
    """Greatest radius that the trees gave to the piece that ends at each node, (n,), mm."""
    radius = np.zeros(len(lines.parent))
    pieces = np.flatnonzero(lines.parent >= 0)
    begin, end = lines.points[lines.parent[pieces]], lines.points[pieces]
    # Branches leave a piece on its axis, and it is widest before the first of them.
    place = begin + 0.02 * (end - begin)
    for tree, number in zip(trees, np.unique(lines.tree), strict=True):
        given = np.flatnonzero(tree.given)
        a, b = tree.proximal[given], tree.distal[given]
        mine = np.flatnonzero(lines.tree[pieces] == number)
        near = cKDTree(np.concatenate([a, 0.5 * (a + b), b])).query(place[mine], 24)[1]
        near = np.minimum(near, 3 * len(given) - 1) % len(given)
        way, to = (b - a)[near], place[mine][:, None] - a[near]
        part = np.clip((way * to).sum(-1) / np.maximum((way * way).sum(-1), 1e-300), 0.0, 1.0)
        away = np.linalg.norm(to - part[..., None] * way, axis=-1)
        nearest = given[near[np.arange(len(mine)), away.argmin(axis=1)]]
        radius[pieces[mine]] = tree_radii(tree)[nearest]
    for inlet in np.flatnonzero(lines.parent < 0):
        radius[inlet] = radius[lines.tree == lines.tree[inlet]].max()
    return radius


def laid(
    tissue: Tissue,
    plan: TrunkPlan,
    lines: TrunkLines,
    radius: FloatArray,
    options: GrowthOptions,
) -> tuple[TrunkLines, TrunkLines, FloatArray]:
    """The lines, smooth, at the depth that their radii (n,) ask for; they as given; their radii.

    Branches that are in each other's way fork later or are left away.
    """
    for number in itertools.count():
        deep = np.maximum(DEPTH_MARGIN * radius + options.clearance_mm, plan.shallow_mm)
        keep = kept_at_depth(tissue, deep, lines.parent < 0, plan.exactly)
        smooth = smooth_lines(tissue, lines, _both(keep, plan.keep, lines.parent < 0))
        later = number < _LATER
        clearer = clear_trunks(tissue, smooth, lines, radius, options, plan.wider, later, plan.main)
        if clearer is None:
            break
        lines, radius = clearer
    return smooth, lines, radius


def _both(
    one: Callable[[FloatArray], FloatArray],
    two: Callable[[FloatArray], FloatArray] | None,
    fixed: NDArray[np.bool_],
) -> Callable[[FloatArray], FloatArray]:
    """One function after the other; the second doesn't move what is fixed."""
    if two is None:
        return one
    after = two

    def keep(points: FloatArray) -> FloatArray:
        points = one(points)
        return np.where(fixed[:, None], points, after(points))

    return keep


def roots_of(lines: TrunkLines, radius: FloatArray, options: GrowthOptions) -> list[RootSpec]:
    """One root for each tree of the lines, with its territory and its share of the terminals."""
    trees = np.unique(lines.tree)
    starts = [int(np.flatnonzero((lines.tree == t) & (lines.parent < 0))[0]) for t in trees]
    share = lines.share[starts] / lines.share[starts].sum()
    counts = np.floor(share * options.terminals).astype(np.int64)
    counts[np.argmax(share)] += options.terminals - int(counts.sum())
    roots = []
    for tree, count in zip(trees.tolist(), counts.tolist(), strict=True):
        part = count / options.terminals
        owns = None if len(trees) == 1 else _nearest_tree(lines, tree)
        roots.append(
            RootSpec(
                replace(options, terminals=int(count)),
                VesselKind.ARTERY,
                trunk_from(lines, tree, float(radius.max())),
                # The flow follows the terminals exactly, so that all have the same.
                Surroundings(owns=owns, share=part),
            )
        )
    return roots


def _pervading(
    lines: TrunkLines, radius: FloatArray, whole: TrunkLines, plan: TrunkPlan
) -> list[RootSpec]:
    """One root for each tree, all of them with the whole tissue; radii are those of ``whole``."""
    return [
        RootSpec(
            options,
            VesselKind.ARTERY,
            trunk_from(lines, tree, float(radius[whole.tree == tree].max())),
            Surroundings(),
        )
        for tree, options in enumerate(plan.each)
    ]


def _nearest_tree(lines: TrunkLines, tree: int) -> Callable[[FloatArray], NDArray[np.bool_]]:
    """Function that tells which points are nearest to a node of this tree."""
    index, number = cKDTree(lines.points), lines.tree

    def owns(points: FloatArray) -> NDArray[np.bool_]:
        mine: NDArray[np.bool_] = number[index.query(points)[1]] == tree
        return mine

    return owns
