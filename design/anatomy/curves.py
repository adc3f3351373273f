"""Round the bends and main lines of a vessel tree with short straight segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.network import VesselKind, VesselNetwork
from design.vasculature.growth.forest import joined_networks
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_from_topology, tree_radii
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Curves(NamedTuple):
    """How far curves reach, and which turns they leave; angles in rad."""

    reach: float = 0.42  # part of a vessel on either side of a node that its curve may take
    straight: float = float(np.radians(9.0))  # turns below this stay as they are
    take_off: float = float(np.radians(20.0))  # by which each of two equal children leaves
    joint: float = 3.0  # radii about a joint within which pieces are few: there walls are joined
    near: float = float(np.radians(18.0))  # turns that stay as they are there
    passes: int = 3  # corner cuttings (Chaikin 1974, doi 10.1016/0146-664X(74)90028-8)


CURVES = _Curves()
STRAIGHT = CURVES.straight


@dataclass(frozen=True)
class Lines:
    """Nodes of a tree, whose vessels are pieces between a node and its parent; 0 is the inlet."""

    points: FloatArray  # (n, 3), mm
    parent: IntArray  # -1 for the inlet; parents stand before their children
    origin: IntArray  # segment of the tree that the piece which ends at a node comes from, or -1
    corner: IntArray  # node of the tree whose curve a node belongs to, or -1


class Bends(NamedTuple):
    """How the main line at the end of each segment (s,) of a tree is curved."""

    reach: FloatArray  # of the curve over what it may: 0 to 1
    main: IntArray  # child that goes on, -1 for none (`main_children`)
    forked: BoolArray  # whether both children are as wide: both leave by a small turn
    least: FloatArray  # turn that stays as it is, rad


def curve_tree(tree: VesselTree, bends: Bends) -> tuple[VesselTree, Lines]:
    """Return the tree with its bends and main lines rounded, radii derived anew.

    Lengths change a little, and with them the radii that give each terminal its flow: they are
    derived from the curved tree, so that flows and Murray's law stay exact.

    Returns
    -------
    VesselTree
        Bends are segments of one child.
    Lines
        Where each of its segments comes from; segment ``i`` ends at node ``i + 1``.
    """
    room = CURVES.joint * tree_radii(tree)
    room = np.where(tree.parent >= 0, room[tree.parent], room)
    lines = _cut_joints(tree, bends, room)
    for _ in range(CURVES.passes):
        lines = _cut_bends(lines, bends.least, room)
    points, up = lines.points, lines.parent[1:]
    return derived_tree(tree, points[up], points[1:], up - 1, origin=lines.origin[1:]), lines


def main_children(tree: VesselTree, radius: FloatArray | None = None) -> IntArray:
    """Return the wider child of each segment, by its own or other radii (s,); -1 for none."""
    radius = tree_radii(tree) if radius is None else radius
    a, b = tree.children.T.astype(np.int64)
    wider = np.where((b >= 0) & (radius[np.maximum(b, 0)] > radius[np.maximum(a, 0)]), b, a)
    return np.asarray(np.where(a < 0, -1, wider), dtype=np.int64)


def turns(tree: VesselTree) -> tuple[IntArray, FloatArray]:
    """Return segments with a child, and the angle (rad) between each and its main child."""
    main = main_children(tree)
    upper = np.flatnonzero(main >= 0)
    way = tree.distal - tree.proximal
    return upper, _angle(way[upper], way[main[upper]])


def _cut_joints(tree: VesselTree, bends: Bends, room: FloatArray) -> Lines:
    """Cut the corner at each node where the main line turns; the node moves onto the cut.

    At a fork the node stays, and each child begins by a small turn.
    """
    count = len(tree.parent)
    reach, main, forked, least = bends
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    way = (tree.distal - tree.proximal) / length[:, None]
    upper = np.flatnonzero((main >= 0) & ~forked)
    lower = main[upper]
    cut = CURVES.reach * reach[upper] * np.minimum(length[upper], length[lower])
    low = np.where(cut < room[upper], np.maximum(least[upper], CURVES.near), least[upper])
    turning = _angle(way[upper], way[lower]) > low
    upper, lower, cut = upper[turning], lower[turning], cut[turning]
    # Nodes beside a joint: before it on the upper segment, after it on a lower one.
    before, after = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    before[upper] = tree.distal[upper] - cut[:, None] * way[upper]
    after[lower] = tree.distal[upper] + cut[:, None] * way[lower]
    node = tree.distal.copy()
    node[upper] = 0.5 * (before[upper] + after[lower])
    fork = np.flatnonzero(forked)
    for child in tree.children[fork].T:
        leaves = _turned(way[fork], way[child], CURVES.take_off)
        step = CURVES.reach * reach[fork] * length[tree.children[fork]].min(axis=1)
        after[child] = tree.distal[fork] + step[:, None] * leaves
    corner_here = np.zeros(count, dtype=np.bool_)
    corner_here[upper] = True
    points, parent, origin, corner = [tree.proximal[0]], [-1], [-1], [-1]
    place = np.zeros(count, dtype=np.int64)
    has_after, has_before = np.isfinite(after[:, 0]), np.isfinite(before[:, 0])
    for s in downward_order(tree.children).tolist():
        above = 0 if tree.parent[s] < 0 else int(place[tree.parent[s]])
        own = s if corner_here[s] or forked[s] else -1
        for there, nodes, of in (
            (has_after[s], after, int(tree.parent[s])),
            (has_before[s], before, s),
            (True, node, own),
        ):
            if there:
                points.append(nodes[s])
                parent.append(above)
                origin.append(s)
                corner.append(of)
                above = len(points) - 1
        place[s] = above
    return Lines(np.array(points), np.array(parent), np.array(origin), np.array(corner))


def _turned(one: FloatArray, two: FloatArray, most: float) -> FloatArray:
    """Turn unit vectors ``one`` (n, 3) towards ``two`` by the angle between, or ``most``."""
    across = two - np.einsum("ij,ij->i", one, two)[:, None] * one
    size = np.linalg.norm(across, axis=1)
    across = across / np.where(size > 0, size, np.inf)[:, None]
    angle = np.minimum(_angle(one, two), most)[:, None]
    turned: FloatArray = np.cos(angle) * one + np.sin(angle) * across
    return turned


def _cut_bends(lines: Lines, least: FloatArray, room: FloatArray) -> Lines:
    """Put two nodes in place of each that is no joint and turns.

    Nodes nearer than ``room`` (s,), mm, to a joint turn by ``CURVES.near`` before they are.
    """
    inner = np.flatnonzero(lines.parent >= 0)
    count = np.bincount(lines.parent[inner], minlength=len(lines.parent))
    child = np.full(len(lines.parent), -1, dtype=np.int64)
    child[lines.parent[inner]] = inner
    at = np.flatnonzero((count == 1) & (lines.parent >= 0))
    here, up, down = lines.points[at], lines.parent[at], child[at]
    before, after = here - lines.points[up], lines.points[down] - here
    long_before, long_after = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    wide, low = room[lines.origin[at]], least[lines.origin[at]]
    near = ((count[up] > 1) & (long_before < wide)) | ((count[down] > 1) & (long_after < wide))
    turning = _angle(before, after) > np.where(near, np.maximum(low, CURVES.near), low)
    step = 0.25 * np.minimum(long_before, long_after)[:, None]
    first = here - step * before / long_before[:, None]
    second = here + step * after / long_after[:, None]
    at, first, second = at[turning], first[turning], second[turning]
    copies = np.ones(len(lines.parent), dtype=np.int64)
    copies[at] = 2
    old, last = np.repeat(np.arange(len(copies)), copies), np.cumsum(copies) - 1
    points, origin, corner = lines.points[old], lines.origin[old], lines.corner[old]
    parent = np.where(lines.parent[old] >= 0, last[lines.parent[old]], -1)
    points[last[at] - 1], points[last[at]] = first, second
    parent[last[at]] = last[at] - 1
    # The upper part of what was the lower piece belongs to the lower piece's segment.
    origin[last[at]] = lines.origin[child[at]]
    return Lines(points, parent, origin, corner)


def derived_tree(
    tree: VesselTree,
    proximal: FloatArray,
    distal: FloatArray,
    parent: NDArray[np.integer],
    children: NDArray[np.integer] | None = None,
    origin: IntArray | slice = slice(None),
    flow_ul_s: float | None = None,
    pressure_drop_pa: float | None = None,
) -> VesselTree:
    """Return a tree of other segments with a tree's pressure drop and blood, radii derived anew.

    Parameters
    ----------
    proximal, distal : (n, 3) float64, mm
    parent : (n,) int
    children : (n, 2) int, optional
        Found from ``parent`` by default, in the order of their numbers.
    origin : (n,) int64
        Segment of ``tree`` whose part of the flow each has; the same segments by default.
    flow_ul_s, pressure_drop_pa : float, optional
        Of the whole tree, in the place of those of ``tree``.
    """
    derived = tree_from_topology(
        proximal,
        distal,
        parent.astype(np.int32),
        (children_of(parent) if children is None else children).astype(np.int32),
        flow_ul_s=float(tree.flow_ul_s[0]) if flow_ul_s is None else flow_ul_s,
        pressure_drop_pa=tree.pressure_drop_pa if pressure_drop_pa is None else pressure_drop_pa,
        murray_exponent=tree.murray_exponent,
        viscosity_pa_s=tree.viscosity_pa_s,
        relative_flow=tree.relative_flow[origin],
        haematocrit=tree.haematocrit,
        given=tree.given[origin],
    )
    return replace(derived, notes=tree.notes)


def children_of(parent: NDArray[np.integer]) -> IntArray:
    """Return the children (n, 2) of each segment, -1 for none; ``parent`` (n,) is -1 at roots."""
    children = np.full((len(parent), 2), -1, dtype=np.int64)
    below = np.flatnonzero(parent >= 0)
    order = below[np.argsort(parent[below], kind="stable")]
    first = np.concatenate([[True], np.diff(parent[order]) > 0])
    children[parent[order[first]], 0] = order[first]
    children[parent[order[~first]], 1] = order[~first]
    return children


def _angle(one: FloatArray, two: FloatArray) -> FloatArray:
    across = np.linalg.norm(np.cross(one, two), axis=1)
    angle: FloatArray = np.arctan2(across, np.einsum("ij,ij->i", one, two))
    return angle


def curved_network(trees: Sequence[VesselTree], kinds: Sequence[VesselKind]) -> VesselNetwork:
    """Return all trees as one network; a vessel reaches from joint to joint, through all its bends.

    Veins and lymph flow from terminals to root.
    """
    return joined_networks(
        [_of_tree(*each, number) for number, each in enumerate(zip(trees, kinds, strict=True))]
    )


def tree_runs(tree: VesselTree) -> list[IntArray]:
    """Return a tree's segments from joint to joint, each run after the one that it leaves."""
    order = downward_order(tree.children)
    # A bend's one child comes next.
    ends = np.flatnonzero((tree.children[order, 0] < 0) | (tree.children[order, 1] >= 0))
    return np.split(order.astype(np.int64), ends[:-1] + 1)


def _of_tree(tree: VesselTree, kind: VesselKind, number: int) -> VesselNetwork:
    runs = tree_runs(tree)
    first, last = np.array([[run[0], run[-1]] for run in runs]).T
    nodes = np.concatenate([tree.proximal[:1], tree.distal[last]])
    node = np.zeros(len(tree.parent) + 1, dtype=np.int64)  # the last one stands for no parent
    node[last] = 1 + np.arange(len(runs))
    ends = np.column_stack([node[tree.parent[first]], node[last]])
    lines = [
        np.concatenate([nodes[begin][None], tree.distal[run]])
        for begin, run in zip(ends[:, 0], runs, strict=True)
    ]
    if kind in (VesselKind.VEIN, VesselKind.LYMPH):
        ends = np.ascontiguousarray(ends[:, ::-1])
        lines = [line[::-1] for line in lines]
    sizes = [len(line) for line in lines]
    return VesselNetwork(
        nodes,
        ends,
        np.full(len(runs), int(kind), dtype=np.int64),
        np.full(len(runs), number, dtype=np.int64),
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        np.concatenate(lines),
        # One radius from joint to joint, to the last digit.
        np.repeat(tree_radii(tree)[first], sizes),
    )
