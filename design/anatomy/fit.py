"""Fit an organ's trees: vessels apart, in the tissue, curved, with so many terminals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import NamedTuple

import numpy as np

from design.anatomy.curves import (
    STRAIGHT,
    Bends,
    Lines,
    curve_tree,
    derived_tree,
    main_children,
    turns,
)
from design.anatomy.trunk_lines import outward
from design.errors import CrowdedError, GrowthError, WideTrunkError
from design.network import VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import BoolArray, FloatArray, IntArray

Trees = tuple[VesselTree, ...]


class _Fit(NamedTuple):
    """How closely vessels are fitted, and for how long it is tried."""

    rounds: int = 12
    room: float = 1.04  # clearance over that asked for: radii change when the last terminals go
    # Of the terminals, what is left to spare once all are clear of each other, and at last: each
    # that goes changes all radii a little.
    spare: float = 0.03
    least_spare: float = 0.001
    # Turns, degrees, above which a main line has a kink, in vessels wider than a part of the root.
    kink: float = 30.0
    wide: float = 0.05
    # Curves.
    halvings: int = 10
    shorter: float = 0.5  # reach of a curve in the way of something, over that before
    shortest: float = 0.01
    again: float = float(np.radians(24.0))  # turns that stay when curves are curved anew
    fine: float = 0.25  # of the root's radius, below which all turns are as coarse as that
    joint: float = 0.95  # of a joint's reach, which shrinks with radii when spare terminals go
    stuck: int = 3  # rounds that mend nothing, after which curves are left as they are
    # Pushes.
    pushes: int = 40
    rises: int = 2  # of them, in which trunks rise that lie deeper than they need
    more: float = 1.1  # clearance that is aimed at, over that asked for
    neighbours: int = 3  # on either side, over which a push is spread
    # Trunks too wide for their wall.
    feeds_many: float = 0.3  # of all terminals: more than can be grown to spare elsewhere
    wider: float = 1.01  # radii that have room, over the tree's: curves change them a little
    margin: float = 1.1  # pressure drop that is advised, over that which is just enough
    places_across: int = 11  # of a trunk where its depth is measured
    steady: int = 4  # terminals of a vessel that hardly changes when one beside it goes


FIT = _Fit()
KINK = FIT.kink


class Clearance(NamedTuple):
    """Clearance between vessels, as in `GrowthOptions`; ``room`` times as much is kept."""

    mm: float
    ratio: float
    room: float = 1.0


class Misfits(NamedTuple):
    """Segments of all trees, numbered on, that don't fit."""

    pairs: IntArray  # (k, 2), nearer than the clearance
    out: IntArray  # (m,), that reach out of the tissue

    @property
    def total(self) -> int:
        """How many."""
        return len(self.pairs) + len(self.out)


class Goal(NamedTuple):
    """What fitted trees have: all vessels clear of each other and in the tissue, and no kinks."""

    clearance: Clearance
    terminals: int  # of each tree
    shared: bool = False  # whether all trees have these together
    shallow_mm: float | None = None  # depth above which no trunk rises; by default none rises


def fit_trees(tissue: Tissue, trees: Trees, goal: Goal) -> Trees:
    """Push trees apart, curve and prune them until the goal is reached.

    Parameters
    ----------
    trees : tuple of VesselTree
        With some terminals to spare and the flow that they keep (`with_flows`), grown with more
        clearance than is kept.

    Raises
    ------
    CrowdedError
        When too many terminals don't fit.
    WideTrunkError
        When trunks that feed many are too wide for the wall.
    GrowthError
        When something doesn't fit after all rounds.
    """
    clearance, closer = goal.clearance, goal.clearance._replace(room=FIT.room)
    # What is pruned for good goes before vessels are curved and fit closely.
    done, least = _cleared(tissue, trees, closer, goal.shallow_mm), STRAIGHT
    spare, fewest = (ceil(part * goal.terminals) for part in (FIT.spare, FIT.least_spare))
    for _ in range(FIT.rounds):
        done = _cleared(tissue, _trimmed(done, goal, spare), closer, goal.shallow_mm)
        done, bad = curve_trees(tissue, done, closer, least, FIT.again)
        least, final = FIT.again, done
        if bad.total:
            continue
        final = _trimmed(done, goal, 0)
        if misfits(tissue, final, clearance).total:
            final = push_apart(tissue, final, clearance)
            if kinks(final):
                final, _ = curve_trees(tissue, final, clearance, FIT.again, FIT.again)
        bad = misfits(tissue, final, clearance)
        if not bad.total and not kinks(final):
            return final
        spare = max(fewest, spare // 4)
    raise GrowthError(
        f"{len(bad.pairs)} pairs of vessels are too near, {len(bad.out)} pieces out of the tissue "
        f"and {kinks(final)} kinks are left after {FIT.rounds} rounds; ask for fewer terminals or "
        "a higher pressure_drop_mmhg"
    )


def with_flows(trees: Trees, goal: Goal) -> Trees:
    """Return trees whose terminals have the flow that is theirs when those to spare are gone."""
    inflow = [float(tree.flow_ul_s[0]) for tree in trees]
    flows = [sum(inflow) if goal.shared else one for one in inflow]
    return tuple(
        replace(tree, terminal_flow_ul_s=flow / goal.terminals)
        for tree, flow in zip(trees, flows, strict=True)
    )


def _cleared(tissue: Tissue, trees: Trees, clearance: Clearance, shallow_mm: float | None) -> Trees:
    """Return the trees pushed apart, without what then doesn't fit."""
    for _ in range(FIT.rounds):
        trees = push_apart(tissue, trees, clearance, shallow_mm)
        bad = misfits(tissue, trees, clearance)
        if not bad.total:
            break
        check_trunks(tissue, trees, bad.out, clearance.mm)
        trees = _without(trees, bad)
    return trees


def check_trunks(tissue: Tissue, trees: Trees, out: IntArray, clearance_mm: float) -> None:
    """Raise if trunk pieces, numbered on, that reach ``out`` of the tissue feed too many terminals.

    Such a piece is too wide for the wall, wherever it is moved.

    Raises
    ------
    WideTrunkError
    """
    every = _Segments.of(trees)
    total = sum(int(tree.terminals[0]) for tree in trees)
    out = out[every.given[out] & (every.fed[out] > FIT.feeds_many * total)]
    if not len(out):
        return
    end, radius = every.end[out], FIT.wider * every.radius[out]
    # What was moved may lie beyond the middle of the wall.
    across = np.linspace(-0.5, 0.5, FIT.places_across)[:, None, None] * outward(tissue, end)
    places = (end + radius[:, None] * across).reshape(-1, 3)
    deep = -tissue.grid.distance(places).reshape(len(across), -1).min(axis=0) - clearance_mm
    worst = int(np.argmin(deep / radius))
    # A piece's end may have room where its middle hasn't.
    narrower = min(1.0 / FIT.wider, max(float(deep[worst] / radius[worst]), 0.1))
    x, y, z = end[worst]
    raise WideTrunkError(
        f"a trunk {2 * radius[worst]:.3g} mm wide, which feeds {every.fed[out[worst]]} of {total} "
        f"terminals, doesn't fit in the wall near ({x:.4g}, {y:.4g}, {z:.4g}) mm: beside "
        f"clearance_mm there's room for {2 * max(float(deep[worst]), 0.0):.3g} mm",
        drop_factor=FIT.margin * narrower**-4,
    )


class _Segments(NamedTuple):
    """Segments of all trees, numbered on; each tree's ``first`` one, and how many there are."""

    begin: FloatArray
    end: FloatArray
    radius: FloatArray
    parent: IntArray
    fed: IntArray  # terminals downstream
    given: BoolArray  # trunks
    first: IntArray

    @staticmethod
    def of(trees: Sequence[VesselTree]) -> _Segments:
        """Join trees."""
        first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
        parents = [
            np.where(t.parent >= 0, t.parent + a, -1)
            for t, a in zip(trees, first[:-1], strict=True)
        ]
        return _Segments(
            np.concatenate([tree.proximal for tree in trees]),
            np.concatenate([tree.distal for tree in trees]),
            np.concatenate([tree_radii(tree) for tree in trees]),
            np.concatenate(parents),
            np.concatenate([tree.terminals for tree in trees]),
            np.concatenate([tree.given for tree in trees]),
            first,
        )


def misfits(
    tissue: Tissue, trees: Sequence[VesselTree], clearance: Clearance, joint_part: float = 1.0
) -> Misfits:
    """Find what doesn't fit; a root's segment may begin outside.

    Joints reach a little less far with more room: radii may still change. So do they with
    ``joint_part``, of their reach.
    """
    mm, ratio, room = clearance
    near = collisions(forest_to_network(trees), mm, ratio, room, min(joint_part, room**-0.5))
    return Misfits(near.vessels, _reaching_out(tissue, _Segments.of(trees), room * mm))


def _reaching_out(tissue: Tissue, every: _Segments, mm: float) -> IntArray:
    inside = tissue.grid.capsule_inside(every.begin, every.end, every.radius, mm)
    return np.flatnonzero(~inside & (every.parent >= 0))


# Round bends as far as there is room.


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
    return sum(len(_kinked(tree, of_root)) for tree in trees)


def _kinked(tree: VesselTree, of_root: float = FIT.wide) -> IntArray:
    """Return segments at whose end a main line has a kink."""
    upper, turn = turns(tree)
    radius = tree_radii(tree)
    sharp = (turn > np.radians(FIT.kink)) & (radius[upper] > of_root * float(radius[0]))
    return np.asarray(upper[sharp])


# Move nodes until vessels keep their clearance and lie in the tissue.


def push_apart(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance: Clearance,
    shallow_mm: float | None = None,
) -> Trees:
    """Move nodes until vessels are clear of each other and in the tissue, or as far as it goes.

    Of two that are too near each gives way, the thinner one more; neighbours along a vessel
    follow. Inlets stay. At first trunks rise to the depth that their radii need, or
    ``shallow_mm`` where it is given.
    """
    trees = tuple(trees)
    for n in range(FIT.pushes):
        every = _Segments.of(trees)
        shift, worst = _pushes(forest_to_network(trees), every, clearance)
        back = _back(tissue, every, clearance.room * clearance.mm)
        shift += back
        if shallow_mm is not None and n < FIT.rises:
            shift += _rise(tissue, every, clearance, shallow_mm)
        elif worst <= 0.0 and not back.any():
            break
        end = every.end + _spread(every.parent, shift)
        trees = tuple(
            moved_tree(tree, end[a:b])
            for tree, a, b in zip(trees, every.first[:-1], every.first[1:], strict=True)
        )
    return trees


def moved_tree(tree: VesselTree, distal: FloatArray) -> VesselTree:
    """Return the same tree with other far ends (n, 3), its radii derived anew."""
    inner = (tree.parent >= 0)[:, None]
    proximal = np.where(inner, distal[np.maximum(tree.parent, 0)], tree.proximal)
    return derived_tree(tree, proximal, distal, tree.parent, tree.children)


def _pushes(
    network: VesselNetwork, every: _Segments, clearance: Clearance
) -> tuple[FloatArray, float]:
    """Return how far the end of each segment is to move for what is near, (n, 3), mm.

    And how much the nearest pair lacks, mm; at most 0 where all are clear.
    """
    mm, ratio, room = clearance
    begin, end, radius = every.begin, every.end, every.radius
    shift, pushed = np.zeros_like(end), np.zeros(len(end))
    near = collisions(network, mm, ratio, FIT.more, room**-0.5)
    if not near.count:
        return shift, 0.0
    one, two = near.pieces.T
    need = np.maximum(mm, ratio * np.minimum(radius[one], radius[two]))
    lack = FIT.more * need - near.gap_mm
    for mine, other in ((one, two), (two, one)):
        way = end[mine] - begin[mine]
        along = np.einsum("ij,ij->i", near.place_mm - begin[mine], way)
        part = np.clip(along / np.einsum("ij,ij->i", way, way), 0.0, 1.0)
        off = begin[mine] + part[:, None] * way - near.place_mm
        off /= np.maximum(np.linalg.norm(off, axis=1), 1e-12)[:, None]
        far = lack * radius[other] / (radius[mine] + radius[other])
        far = np.minimum(far, 0.5 * radius[mine])
        for node, weight in ((mine, part), (every.parent[mine], 1.0 - part)):
            there = node >= 0
            np.add.at(shift, node[there], (far * weight)[there, None] * off[there])
            np.add.at(pushed, node[there], weight[there])
    return shift / np.maximum(pushed, 1.0)[:, None], float((room * need - near.gap_mm).max())


def _back(tissue: Tissue, every: _Segments, mm: float) -> FloatArray:
    """Return how far the end of each segment is to move into the tissue, (n, 3), mm."""
    out = _reaching_out(tissue, every, mm)
    wanted, shift = np.zeros(len(every.radius)), np.zeros_like(every.end)
    for nodes in (out, every.parent[out]):
        np.maximum.at(wanted, nodes, every.radius[out] + mm)
    nodes = np.flatnonzero(wanted)
    lack = wanted[nodes] + tissue.grid.distance(every.end[nodes])
    far = np.maximum(lack, 0.03 * wanted[nodes])
    shift[nodes] = -FIT.more * far[:, None] * outward(tissue, every.end[nodes])
    return shift


def _rise(tissue: Tissue, every: _Segments, clearance: Clearance, shallow_mm: float) -> FloatArray:
    """Return how far ends (n, 3), mm, of trunks that lie too deep are to rise."""
    nodes = np.flatnonzero(every.given & (every.parent >= 0))
    room = FIT.wider * every.radius[nodes] + clearance.room * clearance.mm
    deeper = -tissue.grid.distance(every.end[nodes]) - np.maximum(room, shallow_mm)
    shift = np.zeros_like(every.end)
    shift[nodes] = np.maximum(deeper, 0.0)[:, None] * outward(tissue, every.end[nodes])
    return shift


def _spread(parent: IntArray, shift: FloatArray) -> FloatArray:
    """Return pushes (n, 3) of nodes spread over their neighbours; what is pushed goes as far."""
    up = np.flatnonzero(parent >= 0)
    pushed = np.linalg.norm(shift, axis=1)[:, None] > 0.0
    spread = shift
    for _ in range(FIT.neighbours):
        total, count = spread.copy(), np.ones(len(shift))
        np.add.at(total, up, spread[parent[up]])
        np.add.at(total, parent[up], spread[up])
        np.add.at(count, up, 1.0)
        np.add.at(count, parent[up], 1.0)
        spread = np.where(pushed, shift, total / count[:, None])
    return spread


# Remove terminals from vessel trees: first of colliding vessels, then above a wanted number.


def _without(trees: Trees, bad: Misfits) -> Trees:
    """Return the trees without what feeds fewer terminals of each pair, and without what is out."""
    every = _Segments.of(trees)
    a, b = bad.pairs.T
    a_goes = (every.fed[a] < every.fed[b]) | ((every.fed[a] == every.fed[b]) & (a < b))
    gone = np.zeros(len(every.fed), dtype=np.bool_)
    gone[np.where(a_goes, a, b)] = gone[bad.out] = True
    return tuple(
        without_terminals(tree, terminals_below(tree, gone[first : first + len(tree.parent)]))
        for tree, first in zip(trees, every.first[:-1], strict=True)
    )


def without_terminals(tree: VesselTree, gone: BoolArray) -> VesselTree:
    """Return the tree without the terminals (n,) that are gone, and what led to these alone.

    Each terminal that stays keeps its flow; a joint of one child left becomes a bend.

    Raises
    ------
    GrowthError
        When none would stay.
    """
    if not gone.any():
        return tree
    kept = _kept_segments(tree, gone)
    if not kept[0]:
        raise GrowthError("no vessel of a tree fits where its trunk runs; move its inlet")
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)  # the last one stands for none
    a, b = number[tree.children[kept]].T
    a, b = np.where(a < 0, b, a), np.where(a < 0, -1, b)
    left = float(tree.relative_flow[kept][a < 0].sum()) * tree.terminal_flow_ul_s
    return derived_tree(
        tree,
        tree.proximal[kept],
        tree.distal[kept],
        number[tree.parent[kept]],
        np.column_stack([a, b]),
        np.flatnonzero(kept),
        flow_ul_s=left,
    )


def _kept_segments(tree: VesselTree, gone: BoolArray) -> BoolArray:
    """Return which segments (n,) lead to a terminal that stays."""
    kept = (tree.children[:, 0] < 0) & ~gone
    for i in downward_order(tree.children)[::-1]:
        if tree.parent[i] >= 0:
            kept[tree.parent[i]] |= kept[i]
    return kept


def terminals_below(tree: VesselTree, segments: BoolArray) -> BoolArray:
    """Return which segments (n,) are terminals at or below any of ``segments`` (n,)."""
    below = segments.copy()
    for i in downward_order(tree.children):
        if tree.parent[i] >= 0:
            below[i] |= below[tree.parent[i]]
    return np.asarray(below & (tree.children[:, 0] < 0))


def _trimmed(trees: Trees, goal: Goal, spare: int) -> Trees:
    """Return trees with as many terminals as are wanted, and some to spare where they have them."""
    counts = np.array([int(tree.terminals[0]) for tree in trees])
    have = int(counts.sum()) if goal.shared else int(counts.min())
    if have < goal.terminals:
        raise CrowdedError(have, goal.terminals)
    if goal.shared:  # each tree gives in proportion to what it has
        extra = max(have - goal.terminals - spare, 0)
        goes = np.floor(extra * counts / have).astype(np.int64)
        goes[np.argmax(counts)] += extra - int(goes.sum())
    else:
        goes = np.maximum(counts - goal.terminals - spare, 0)
    return tuple(_fewer(tree, many) for tree, many in zip(trees, goes.tolist(), strict=True))


def _fewer(tree: VesselTree, many: int) -> VesselTree:
    """Remove so many terminals of a tree; where it had no kinks it gets none, if possible.

    A vessel goes on in its wider child, and of two nearly alike the other one may become the
    wider when terminals go: those of the wider one stay there, and others go.
    """
    stay = np.zeros(len(tree.parent), dtype=np.bool_)
    smooth = many > 0 and not len(_kinked(tree))
    for _ in range(FIT.rounds):
        tips = _side_tips(tree)
        gone = np.zeros(len(tree.parent), dtype=np.bool_)
        gone[np.concatenate([tips[~stay[tips]], tips[stay[tips]]])[:many]] = True
        smaller = without_terminals(tree, gone)
        bent = _kinked(smaller) if smooth else np.empty(0, dtype=np.int64)
        if not len(bent):
            break
        wider = np.zeros(len(tree.parent), dtype=np.bool_)
        wider[main_children(tree)[np.flatnonzero(_kept_segments(tree, gone))[bent]]] = True
        stay |= terminals_below(tree, wider)
    return smaller


def _side_tips(tree: VesselTree) -> IntArray:
    """Return terminals by how little is lost with them: first those that leave a wider vessel.

    Of these, and of the others, the shortest first; a trunk's ends last.
    """
    radius = tree_radii(tree)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    tips = np.flatnonzero(tree.children[:, 0] < 0)
    # A terminal may end a run of pieces: follow it up to its joint.
    top, total = tips.astype(np.int64), length[tips]
    while True:
        above = tree.parent[top]
        on = (above >= 0) & (tree.children[np.maximum(above, 0), 1] < 0)
        if not on.any():
            break
        top = np.where(on, above, top)
        total = total + np.where(on, length[top], 0.0)
    above = np.maximum(tree.parent[top], 0)
    a, b = tree.children[above].T.astype(np.int64)
    beside = np.where(a == top, b, a)
    side = (radius[top] < radius[beside]) & (tree.terminals[beside] >= FIT.steady)
    rank = np.where(tree.given[tips], 2, np.where(side & (tree.parent[top] >= 0), 0, 1))
    return np.asarray(tips[np.lexsort((total, rank))], dtype=np.int64)
