"""Lay trunks as deep as their radii need, and grow a vessel tree from each inlet's trunk."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.main_branches import MainBranch, check_main_branches, line_pieces
from design.anatomy.trunk_lines import (
    TrunkLines,
    in_order,
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
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Laying(NamedTuple):
    """How trunks are laid for the radii that they get."""

    # Depth of a trunk's axis over its radius, beside the clearance: radii rise a little while trees
    # grow and are curved.
    depth_margin: float = 1.03
    wider: float = 1.15  # see `TrunkPlan`
    radius_margin: float = 1.05  # radii of the second growth over those of the first
    growths: int = 2  # at most
    straighter: float = 0.12  # how far lines may be straightened, over their radius
    later: int = 60  # rounds in which branches may fork later; some ten do
    stub: int = 4  # nodes of a branch left over that is too short to stay
    spacing: float = 1.25  # room between trunks over what radii and clearance ask for
    # Way from a fork to where its branches are too near, over their radii, within which they fork
    # later rather than one is left away.
    fork: float = 6.0


LAYING = _Laying()


@dataclass(frozen=True)
class TrunkPlan:
    """Where trunks run, before radii are known."""

    lines: TrunkLines
    shallow_mm: float  # least depth of the trunks' axes
    exactly: bool = True  # whether trunks keep to their depth; else they may lie deeper
    wider: float = LAYING.wider  # radii by which trunks are kept apart, over their own
    # Brings nodes (n, 3) back to a zone, after they were brought to their depth.
    keep: Callable[[FloatArray], FloatArray] | None = None
    # Adds branches that leave the laid lines, whose nodes have radii (n,).
    branches: Callable[[TrunkLines, FloatArray], tuple[TrunkLines, FloatArray]] | None = None
    widest_branch: float | None = None  # see `Trunk`; by default branches count as trunks
    tries: int = len(SPREADS)  # growths from the same trunks at most, where one gets stuck
    # Branches whose nodes stay where others are in their way; some of them mustn't be lost.
    main: tuple[MainBranch, ...] = ()

    @property
    def rises_to_mm(self) -> float | None:
        """Depth to which grown trunks rise; None where branches count as trunks, or lie deeper."""
        return self.shallow_mm if self.exactly and self.widest_branch is not None else None


def grow_from_plan(
    tissue: Tissue, plan: TrunkPlan, each: Sequence[GrowthOptions]
) -> tuple[VesselTree, ...]:
    """Lay the trunks as deep as their radii ask for, and grow trees from them.

    Radii are known once the trees are grown: trunks that come out wider than was thought are laid
    deeper, and the trees grown again.

    Parameters
    ----------
    each : sequence of GrowthOptions
        Of each tree, all of which serve the whole tissue; or one for all, which share it.

    Raises
    ------
    TissueError, GrowthError
        As `grow_forest`; and when trunks don't fit with the radii that they get.
    """
    lines, options = plan.lines, each[0]
    root = np.array([likely_radius(tissue, one) for one in each])
    own = np.minimum(lines.tree, len(each) - 1)
    radius = root[own] * lines.share ** (1 / options.murray_exponent)
    for left in range(LAYING.growths - 1, -1, -1):
        smooth, lines, radius = laid(tissue, plan, lines, radius, options)
        check_main_branches(plan.main, line_pieces(smooth, radius))
        whole, wide = plan.branches(smooth, radius) if plan.branches else (smooth, radius)
        roots = _roots(whole, wide, smooth, plan, each)
        trees = grow_forest(tissue, roots, attempts=plan.tries)
        grown = trunk_radii(smooth, trees)
        if left == 0 or (grown <= radius).all():
            break
        # Which trunk feeds what differs a little from one growth to the next.
        radius = LAYING.radius_margin * grown
    return trees


def _roots(
    whole: TrunkLines,
    radius: FloatArray,
    trunks: TrunkLines,
    plan: TrunkPlan,
    each: Sequence[GrowthOptions],
) -> list[RootSpec]:
    """Return a root for each tree: for the whole tissue, or its share of the terminals.

    Of lines with radii (n,), straightened. What ends at no node of ``trunks`` is a branch.
    """
    lines = thinned(whole, LAYING.straighter * radius)
    first = lines.share[lines.parent < 0]
    total, shared = each[0].terminals, len(each) < len(first)
    counts = np.floor(first / first.sum() * total).astype(np.int64)
    counts[np.argmax(first)] += total - int(counts.sum())
    nodes = {place.tobytes() for place in trunks.points}
    roots = []
    for tree, count in enumerate(counts.tolist()):
        # The flow follows the terminals exactly, so that all have the same.
        own = replace(each[0], terminals=count) if shared else each[tree]
        owns = _nearest_tree(lines, tree) if shared else None
        around = Surroundings(owns=owns, share=count / total if shared else 1.0)
        wide = radius if shared else radius[whole.tree == tree]
        trunk = trunk_from(lines, tree, float(wide.max()))
        if plan.widest_branch is not None:
            planned = np.array([place.tobytes() not in nodes for place in trunk.distal])
            trunk = replace(trunk, planned=planned, widest_branch=plan.widest_branch)
        roots.append(RootSpec(own, VesselKind.ARTERY, trunk, around))
    return roots


def _nearest_tree(lines: TrunkLines, tree: int) -> Callable[[FloatArray], BoolArray]:
    """Return a function that finds which points are nearest to a node of this tree."""
    index, number = cKDTree(lines.points), lines.tree

    def owns(points: FloatArray) -> BoolArray:
        return np.asarray(number[index.query(points)[1]] == tree)

    return owns


def trunk_radii(lines: TrunkLines, trees: Sequence[VesselTree]) -> FloatArray:
    """Return the greatest radius (n,), mm, that trees gave to the piece that ends at each node."""
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
    """Smooth lines at the depth that their radii (n,) need; return also those given, and radii.

    Branches that are in each other's way fork later or are left away.
    """
    main = frozenset(place.tobytes() for one in plan.main for place in one.line)
    for number in itertools.count():
        deep = np.maximum(LAYING.depth_margin * radius + options.clearance_mm, plan.shallow_mm)
        smooth = smooth_lines(tissue, lines, deep, plan.exactly, plan.keep)
        later = number < LAYING.later
        clearer = clear_trunks(tissue, smooth, lines, radius, options, plan.wider, later, main)
        if clearer is None:
            break
        lines, radius = clearer
    return smooth, lines, radius


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
    """Return lines and radii with less in each other's way; None where nothing is.

    Two branches that are too near just after their fork fork a node later, if they may. Of other
    pairs the thinner is left away with all below it, as is what leaves the tissue.

    Parameters
    ----------
    laid, lines : TrunkLines
        Where the nodes lie; the same nodes, of which the result is made.
    radius : (n,) float64, mm
    wider : float
        Radii by which trunks are kept apart, over theirs.
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
    forks = _Forks(lines, laid.points, radius, options.murray_exponent)
    stuck = [(a, b) for a, b in pairs.tolist() if not (later and forks.fork_later(a, b))]
    gone = np.zeros(len(forks.parent), dtype=np.bool_)
    gone[outside] = True
    for a, b in stuck:
        first, second = (lines.points[node].tobytes() in main for node in (a, b))
        a_goes = second if first != second else radius[a] < radius[b]
        thinner = a if a_goes else b
        # What feeds more by now, as another branch was joined on it, is judged once laid anew.
        gone[thinner] |= forks.radius[thinner] <= radius[thinner]
    order, lines = in_order(forks.lines())
    stays = np.array([node not in forks.dropped for node in order.tolist()])
    lines, gone = without(lines, ~stays), gone[order][stays]
    radius = np.array(forks.radius)[order][stays]
    gone = _whole_branches(lines, gone)
    return without(lines, gone), radius[~gone]


class _Forks:
    """Trunk lines whose branches can be joined on elsewhere; a fork is moved once a round."""

    def __init__(
        self, lines: TrunkLines, laid: FloatArray, radius: FloatArray, exponent: float
    ) -> None:
        self.points, self.laid = list(lines.points), list(laid)
        self.parent, self.tree = lines.parent.tolist(), lines.tree.tolist()
        self.share, self.radius = lines.share.tolist(), radius.tolist()
        self.count, self.child = lines.child_count().tolist(), lines.main_child().tolist()
        self.exponent = exponent
        self.touched: set[int] = set()
        self.dropped: set[int] = set()

    def lines(self) -> TrunkLines:
        """Return all lines, dropped nodes among them, in any order."""
        return TrunkLines(
            np.array(self.points), np.array(self.parent), np.array(self.tree), np.array(self.share)
        )

    def fork_later(self, a: int, b: int) -> bool:
        """Join the branch that ends at node ``a`` or ``b`` on a node later; whether it could be."""
        up_a, up_b = self._ancestors(a), self._ancestors(b)
        below = set(up_b)
        fork = next((node for node in up_a if node in below), -1)
        if fork in (-1, a, b):
            return False
        up_a, up_b = (up[: up.index(fork) + 1] for up in (up_a, up_b))
        reach = LAYING.fork * (self.radius[a] + self.radius[b])
        if max(self._length(up_a), self._length(up_b)) > reach:
            return False
        one, two = up_a[-2], up_b[-2]
        main, branch = (one, two) if self.share[one] >= self.share[two] else (two, one)
        if self.touched & {fork, main, branch}:
            return True
        if self.count[main] > 1 and self.count[branch] > 1:
            heir = self.child[main]
            if heir not in self.touched:
                node = self._split(main, heir)
                self._join_on(node, branch)
                self._carry(main, branch)
                self.touched |= {fork, main, branch, heir, node}
            return True
        if self.count[main] != 1:
            main, branch = branch, main
        if self.count[main] != 1 or self.count[branch] == 0:
            return False
        self._join_on(main, branch)
        self.touched |= {fork, main, branch}
        return True

    def _split(self, node: int, child: int) -> int:
        """Put a node midway between a node and its child; its number."""
        middle = len(self.parent)
        for places in (self.points, self.laid):
            places.append(0.5 * (places[node] + places[child]))
        self.tree.append(self.tree[child])
        for values in (self.share, self.radius):
            values.append(values[child])
        self.parent.append(node)
        self.count.append(1)
        self.child.append(child)
        self.parent[child] = middle
        return middle

    def _join_on(self, main: int, branch: int) -> None:
        """Let the branch leave from ``main``, without its first node where that is no fork."""
        first = branch
        if self.count[branch] == 1:
            first = self.child[branch]
            self.dropped.add(branch)
            self.touched.add(first)
        self.parent[first] = main
        self._carry(main, first)

    def _carry(self, node: int, branch: int) -> None:
        """Let a node feed a branch besides what it feeds."""
        self.share[node] += self.share[branch]
        n = self.exponent
        self.radius[node] = (self.radius[node] ** n + self.radius[branch] ** n) ** (1.0 / n)

    def _ancestors(self, node: int) -> list[int]:
        """Return the node and all above it."""
        above = []
        while node >= 0:
            above.append(node)
            node = self.parent[node]
        return above

    def _length(self, nodes: list[int]) -> float:
        way = np.array([self.laid[node] for node in nodes])
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


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
    clear = LAYING.spacing * options.clearance_mm
    near = collisions(network, clear, LAYING.spacing * options.clearance_ratio)
    pairs = piece[near.vessels] if near.count else np.empty((0, 2), dtype=np.int64)
    # What lacks a little is sunk once its radius is known.
    inside = tissue.grid.capsule_inside(
        lines.points[lines.parent[piece]], lines.points[piece], 0.5 * radius[piece]
    )
    enters = lines.parent[lines.parent[piece]] < 0
    return pairs, piece[~inside & ~enters]


def _whole_branches(lines: TrunkLines, gone: BoolArray) -> BoolArray:
    """Mark all below what is gone, and stubs of fewer than `LAYING.stub` nodes above it."""
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
        if len(stub) < LAYING.stub:
            gone[stub] = True
    trees = np.unique(lines.tree[~gone & (lines.parent >= 0)])
    if gone[lines.parent < 0].any() or len(trees) < len(np.unique(lines.tree)):
        raise WideTrunkError("the trunks don't fit with the radii they would have")
    return gone
