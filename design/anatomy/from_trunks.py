"""Lay trunks as deep as their radii need, and grow a vessel tree from each inlet's trunk."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.trunk_lines import (
    TrunkLines,
    in_order,
    kept_at_depth,
    smooth_lines,
    thinned,
    trunk_from,
    without,
)
from design.errors import WideTrunkError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import RootSpec, grow_forest, likely_radius
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.tree import SPREADS
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray, IntArray

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


# Resolve overlaps of planned trunks: fork later, or drop thinner branches.

_STUB = 4
_SPACING = 1.25
"""Room between trunks over what their radii and clearance ask for."""

_FORK = 6.0
"""Way from a fork to where its two branches are too near, over their radii, within which they fork
later rather than one is left away."""


def clear_trunks(
    tissue: Tissue,
    laid: TrunkLines,
    lines: TrunkLines,
    radius: FloatArray,
    options: GrowthOptions,
    wider: float = 1.0,
    later: bool = True,
    main: frozenset[bytes] = frozenset(),
) -> tuple[TrunkLines, FloatArray] | None:
    """Lines and radii with less in each other's way; None where nothing is.

    Two branches that are too near just after their fork fork a node later. Of other pairs the
    thinner is left away with all below it, as is what leaves the tissue.

    Parameters
    ----------
    laid : TrunkLines
        Where the nodes lie.
    lines : TrunkLines
        The same nodes, of which the result is made.
    radius : (n,) float64, mm
    wider : float
        Radii by which trunks are kept apart, over theirs.
    later : bool
        Whether branches may fork later.
    main : frozenset of bytes
        Nodes of ``lines``, as bytes, that stay rather than others, however thin they are.

    Raises
    ------
    WideTrunkError
        Where a tree has no trunk left.
    """
    pairs, outside = _clashes(tissue, laid, wider * radius, options)
    if not len(pairs) + len(outside):
        return None
    tree = _Branches(lines, laid.points, radius, options.murray_exponent)
    gone = np.zeros(len(radius), dtype=np.bool_)
    gone[outside] = True
    stuck: list[tuple[int, int]] = []
    for a, b in pairs.tolist():
        if not (later and tree.fork_later(a, b)):
            stuck.append((a, b))
    for a, b in stuck:
        first, second = (lines.points[node].tobytes() in main for node in (a, b))
        a_goes = second if first != second else radius[a] < radius[b]
        thinner = a if a_goes else b
        # What feeds more by now, as another branch was joined on it, is judged once laid anew.
        gone[thinner] |= tree.radius[thinner] <= radius[thinner]
    order, lines = in_order(TrunkLines(tree.points, tree.parent, tree.tree, tree.share))
    gone = np.append(gone, np.zeros(len(order) - len(gone), dtype=np.bool_))
    dropped, gone, radius = tree.dropped[order], gone[order], tree.radius[order]
    lines, gone, radius = without(lines, dropped), gone[~dropped], radius[~dropped]
    gone = _whole_branches(lines, gone)
    return without(lines, gone), radius[~gone]


class _Branches:
    """Trunk lines whose branches can be joined on elsewhere."""

    def __init__(
        self, lines: TrunkLines, laid: FloatArray, radius: FloatArray, exponent: float
    ) -> None:
        self.points, self.laid, self.tree = lines.points, laid, lines.tree
        self.parent, self.share = lines.parent.copy(), lines.share.copy()
        self.count = lines.child_count()
        self.child = lines.main_child()
        self.radius, self.exponent = radius.copy(), exponent
        self.touched = np.zeros(len(radius), dtype=np.bool_)
        self.dropped = np.zeros(len(radius), dtype=np.bool_)

    def fork_later(self, a: int, b: int) -> bool:
        """Join the branch that ends at node ``a`` or ``b`` on a node later; whether it could be.

        A fork is moved once a round.
        """
        up_a, up_b = self._ancestors(a), self._ancestors(b)
        below = set(up_b)
        fork = next((node for node in up_a if node in below), -1)
        if fork in (-1, a, b):
            return False
        one, two = up_a[up_a.index(fork) - 1], up_b[up_b.index(fork) - 1]
        reach = _FORK * float(self.radius[a] + self.radius[b])
        if max(self._way(up_a, fork), self._way(up_b, fork)) > reach:
            return False
        main, branch = (one, two) if self.share[one] >= self.share[two] else (two, one)
        if self.touched[[fork, main, branch]].any():
            return True
        if self.count[main] > 1 and self.count[branch] > 1:
            return self._join_below(fork, main, branch)
        if self.count[main] != 1:
            main, branch = branch, main
        if self.count[main] != 1 or self.count[branch] == 0:
            return False
        self._join_on(main, branch)
        self.touched[[fork, main, branch]] = True
        return True

    def _join_below(self, fork: int, main: int, branch: int) -> bool:
        """Let the branch leave midway from ``main``, itself a fork, to its wider child."""
        heir = int(self.child[main])
        if self.touched[heir]:
            return True
        node = len(self.parent)
        for name in ("points", "laid"):
            places = getattr(self, name)
            middle = 0.5 * (places[main] + places[heir])
            setattr(self, name, np.append(places, middle[None], axis=0))
        for name, value in (("parent", main), ("count", 1), ("child", heir)):
            setattr(self, name, np.append(getattr(self, name), value))
        for name in ("tree", "share", "radius", "touched", "dropped"):
            values = getattr(self, name)
            setattr(self, name, np.append(values, values[heir]))
        self.parent[heir] = node
        self._join_on(node, branch)
        self._carry(main, branch)
        self.touched[[fork, main, branch, heir, node]] = True
        return True

    def _join_on(self, main: int, branch: int) -> None:
        """Let the branch leave from ``main``, without its first node where that is no fork."""
        first = branch
        if self.count[branch] == 1:
            first = int(self.child[branch])
            self.dropped[branch] = True
            self.touched[first] = True
        self.parent[first] = main
        self._carry(main, first)

    def _carry(self, node: int, branch: int) -> None:
        """Let a node feed a branch besides what it feeds."""
        self.share[node] += self.share[branch]
        n = self.exponent
        self.radius[node] = (self.radius[node] ** n + self.radius[branch] ** n) ** (1.0 / n)

    def _ancestors(self, node: int) -> list[int]:
        """The node and all above it, in the lines as they were given or were joined since."""
        above = []
        while node >= 0:
            above.append(node)
            node = int(self.parent[node])
        return above

    def _way(self, above: list[int], fork: int) -> float:
        path = self.laid[above[: above.index(fork) + 1]]
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _clashes(
    tissue: Tissue, lines: TrunkLines, radius: FloatArray, options: GrowthOptions
) -> tuple[IntArray, IntArray]:
    """Return nodes (k, 2) that end pieces too near each other; (m,) those out of the tissue."""
    piece = np.flatnonzero(lines.parent >= 0)
    network = VesselNetwork.from_segments(
        lines.points,
        np.column_stack([lines.parent[piece], piece]),
        radius[piece],
        np.full(len(piece), int(VesselKind.ARTERY)),
        lines.tree[piece],
    )
    clear = _SPACING * options.clearance_mm
    near = collisions(network, clear, _SPACING * options.clearance_ratio)
    pairs = piece[near.vessels] if near.count else np.empty((0, 2), dtype=np.int64)
    # What lacks a little is sunk once its radius is known.
    inside = tissue.grid.capsule_inside(
        lines.points[lines.parent[piece]], lines.points[piece], 0.5 * radius[piece]
    )
    enters = lines.parent[lines.parent[piece]] < 0
    return pairs, piece[~inside & ~enters]


def _whole_branches(lines: TrunkLines, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """All that lies below what is gone, and stubs of less than `_STUB` nodes above it."""
    if not gone.any():
        return gone
    gone = gone.copy()
    count = lines.child_count()
    for i in range(len(gone)):
        if lines.parent[i] >= 0:
            gone[i] |= gone[lines.parent[i]]
    for i in np.flatnonzero(gone).tolist():
        stub = []
        above = int(lines.parent[i])
        while above >= 0 and not gone[above] and count[above] == 1 and lines.parent[above] >= 0:
            stub.append(above)
            above = int(lines.parent[above])
        if len(stub) < _STUB:
            gone[stub] = True
    trees = np.unique(lines.tree[~gone & (lines.parent >= 0)])
    if gone[lines.parent < 0].any() or len(trees) < len(np.unique(lines.tree)):
        raise WideTrunkError("the trunks don't fit with the radii they would have")
    return gone
