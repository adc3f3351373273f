"""Push colliding vessel trees apart, curve them, and prune to a given number of terminals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import ceil

import numpy as np
from numpy.typing import NDArray

from design.anatomy.curves import STRAIGHT, Lines, curve_tree, derived_tree, main_children, turns
from design.anatomy.trunk_depth import check_trunks, moved_tree, risen_trees, sink_trunk
from design.anatomy.trunk_lines import outward
from design.errors import CrowdedError, GrowthError
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import FloatArray, IntArray

SPARE_APART = 1.2
"""Terminals to grow over those wanted."""
_LAST_SPARE, _FEWEST_SPARE = 0.03, 0.001
"""Of those wanted, what is left to spare once all are clear of each other, and at last. Vessels
are curved and fit as they are with it: each that goes changes all radii a little."""
_ROOM = 1.04
"""Clearance that curves are fitted with, over that asked for: radii change a little when the last
spare terminals go."""


def fitted_apart(
    tissue: Tissue, trees: Trees, clearance_mm: float, clearance_ratio: float, terminals: int
) -> Trees:
    """Trees pushed apart, curved and pruned until all fits, with so many terminals each.

    Parameters
    ----------
    trees : tuple of VesselTree
        With some terminals to spare (`SPARE`), each with the flow that it keeps.
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`.

    Raises
    ------
    GrowthError
        When too many terminals don't fit.
    """
    mm, ratio = clearance_mm, clearance_ratio
    # What is pruned for good goes before vessels are curved and fit closely.
    done, least = _clear(tissue, trees, mm, ratio), STRAIGHT
    spare, fewest = ceil(_LAST_SPARE * terminals), ceil(_FEWEST_SPARE * terminals)
    final = done
    for _ in range(AGAIN):
        done = _clear(tissue, _trimmed(done, terminals, spare), mm, ratio)
        done, bad = curve_trees(tissue, done, mm, ratio, least, SECOND, _ROOM)
        least = SECOND
        if _any(bad):
            continue
        final = _trimmed(done, terminals, 0)
        if _any(misfits(tissue, final, mm, ratio)):
            final = push_apart(tissue, final, mm, ratio)
            if kinks(final):
                final, _ = curve_trees(tissue, final, mm, ratio, SECOND, SECOND)
        bad = misfits(tissue, final, mm, ratio)
        if not _any(bad) and not kinks(final):
            return final
        spare = max(fewest, spare // 4)
    raise _still_unfit(bad, final)


def _still_unfit(bad: Misfits, trees: Trees) -> GrowthError:
    return GrowthError(
        f"{len(bad[0])} pairs of vessels are too near, {len(bad[1])} pieces out of the tissue and "
        f"{kinks(trees)} kinks are left after {AGAIN} rounds; ask for fewer terminals or a higher "
        "pressure_drop_mmhg"
    )


def _any(bad: Misfits) -> bool:
    return bool(bad[0]) or bool(len(bad[1]))


def _clear(tissue: Tissue, trees: Trees, mm: float, ratio: float) -> Trees:
    """The trees pushed apart, without what then doesn't fit."""
    for _ in range(AGAIN):
        trees = push_apart(tissue, trees, mm, ratio, _ROOM)
        bad = misfits(tissue, trees, mm, ratio, _ROOM)
        if not _any(bad):
            break
        trees = without_collisions(trees, *bad)
    return trees


def _trimmed(trees: Trees, terminals: int, spare: int) -> Trees:
    """The trees with so many terminals each, and so many to spare where they have them."""
    fewest = min(int(tree.terminals[0]) for tree in trees)
    if fewest < terminals:
        raise CrowdedError(fewest, terminals)
    return tuple(
        _smooth(tree, min(terminals + spare, int(tree.terminals[0])) if spare else terminals)
        for tree in trees
    )


def _smooth(tree: VesselTree, terminals: int) -> VesselTree:
    """The tree with so many terminals; where it had no kinks it has none, as far as can be.

    A vessel goes on in its wider child, and of two nearly alike the other one may become the
    wider when terminals go: those of the wider one stay there, and others go.
    """
    extra = int(tree.terminals[0]) - terminals
    stay = np.zeros(len(tree.parent), dtype=np.bool_)
    smooth = extra > 0 and not kinks((tree,))
    for _ in range(AGAIN):
        gone = first_tips(tree, extra, stay)
        smaller = without_terminals(tree, gone)
        bent = kinked((smaller,)) if smooth else np.empty(0, dtype=np.int64)
        if not len(bent):
            break
        joints = np.flatnonzero(kept_segments(tree, gone))[bent]
        stay |= terminals_below(tree, main_children(tree)[joints])
    return smaller


# Curve vessel trees, sink trunks and prune until all vessels fit, to a given terminal count.

Trees = tuple[VesselTree, ...]
Misfits = tuple[list[list[int]], IntArray]
KINK = 30.0
"""Turns, degrees, above which a main line has a kink."""
FINE = 0.25
"""Part of the root's radius from which on curves are always fine."""
WIDE = 0.05
"""Part of the root's radius from which on vessels mustn't have kinks."""
SPARE = 1.08
"""Terminals to grow over those wanted: some are taken away where vessels don't fit."""
_CURVE_HALVINGS = 10
AGAIN = 12
SECOND = np.radians(24.0)
_LESS, _LEAST = 0.5, 0.01
JOINT_RESERVE = 0.95
"""Of a joint's reach, within which its branches may be near each other when they are curved: radii
shrink, and joints reach less far, when the terminals to spare go."""
_CHEAP = 0.002
"""Of the terminals, which may go for a vessel that lies in a rising trunk's way."""
_PUSHES = 4
"""Rounds at most in which vessels that feed many are pushed apart rather than taken away."""
_CLEAR = 1.06
"""Clearance that these get, over that asked for: curves need some of it."""
_STUCK = 3
"""Rounds that mend nothing, after which curves are left as they are."""


def fitted_trees(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance_mm: float,
    clearance_ratio: float,
    terminals: int,
    shallow_mm: float | None = None,
) -> Trees:
    """Curved trees of so many terminals that fit: trunks sunk, misfits pruned, kinks rounded.

    Parameters
    ----------
    trees : sequence of VesselTree
        With some terminals to spare (`SPARE`), grown with more clearance than is kept.
    clearance_mm, clearance_ratio : float
        Kept in the end.
    terminals : int
        In the end, of all trees together.
    shallow_mm : float, optional
        Trunks rise to where their radii allow, but no higher than this depth.

    Raises
    ------
    GrowthError
        When too many terminals don't fit.
    WideTrunkError
        When trunks that feed many are too wide for the wall.
    """
    mm, ratio = clearance_mm, clearance_ratio
    done, least = _sunk(tissue, tuple(trees), mm, ratio), STRAIGHT
    flow = float(sum(tree.flow_ul_s[0] for tree in trees)) / terminals
    done = tuple(with_flow(tree, flow) for tree in done)
    if shallow_mm is not None:
        done = risen_trees(tissue, done, mm, shallow_mm, partial(_costly, tissue, mm, ratio))
    for _ in range(AGAIN):
        done, bad = curve_trees(tissue, _sunk(tissue, done, mm, ratio), mm, ratio, least)
        least = SECOND
        if not _any(bad):
            final = trimmed(done, terminals)
            bad = misfits(tissue, final, mm, ratio)
            if not _any(bad) and not kinks(final):
                if shallow_mm is None:
                    return final
                return _risen(tissue, final, mm, ratio, shallow_mm)
            # Most spare terminals go, and what that bends or widens is mended.
            done = _spared(done, terminals)
            bad = misfits(tissue, done, mm, ratio)
        given = np.concatenate([tree.given for tree in done])
        # Trunks that reach out are sunk deeper next time.
        done = without_collisions(done, bad[0], bad[1][~given[bad[1]]])
    raise _still_unfit(bad, done)


def _costly(tissue: Tissue, mm: float, ratio: float, trees: Trees) -> IntArray:
    """Pairs too near that would cost more than a few terminals. What reaches out is sunk next."""
    pairs, _ = misfits(tissue, trees, mm, ratio)
    both = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return np.unique(both[_dear(trees, pairs, both[:0, 0])])


def _dear(trees: Trees, pairs: list[list[int]], out: IntArray) -> NDArray[np.bool_]:
    """Which pairs, and then which segments that reach out, would cost more than a few terminals."""
    fed = np.concatenate([tree.terminals for tree in trees])
    both = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    few = _CHEAP * sum(int(tree.terminals[0]) for tree in trees)
    return np.concatenate([fed[both].min(axis=1), fed[out]]) > few


def _risen(tissue: Tissue, trees: Trees, mm: float, ratio: float, shallow_mm: float) -> Trees:
    """The trees with their trunks as shallow as they fit, kinks no more than before."""
    free = kinks(trees) == 0

    def bad(moved: Trees) -> IntArray:
        pairs, out = misfits(tissue, moved, mm, ratio)
        bent = kinked(moved) if free else np.empty(0, dtype=np.int64)
        flat = np.array(pairs, dtype=np.int64).ravel()
        return np.unique(np.concatenate([flat, out, bent]))

    return risen_trees(tissue, trees, mm, shallow_mm, bad)


def _spared(trees: Trees, terminals: int) -> Trees:
    """The trees with a fifth of the terminals that they have to spare."""
    spare = sum(int(tree.terminals[0]) for tree in trees) - terminals
    return trimmed(trees, terminals + spare // 5)


def _sunk(tissue: Tissue, trees: Trees, clearance_mm: float, clearance_ratio: float) -> Trees:
    """Trees whose trunks lie deep enough, without what then doesn't fit."""
    pushes = _PUSHES
    for left in range(AGAIN - 1, -1, -1):
        trees = tuple(sink_trunk(tissue, tree, clearance_mm) for tree in trees)
        if (
            pushes
            and _dear(trees, *misfits(tissue, trees, clearance_mm, clearance_ratio, _CLEAR)).any()
        ):
            pushes -= 1
            trees = push_apart(tissue, trees, clearance_mm, clearance_ratio, _CLEAR)
        bad = misfits(tissue, trees, clearance_mm, clearance_ratio)
        if not _any(bad):
            break
        pairs, out = bad
        # A trunk that still reaches out is sunk further, rather than taken away with its branches.
        trunk = np.concatenate([tree.given for tree in trees])
        if left == 0:
            check_trunks(tissue, trees, out[trunk[out]], clearance_mm)
        trees = without_collisions(trees, pairs, out if left == 0 else out[~trunk[out]])
    return trees


def curve_trees(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance_mm: float,
    clearance_ratio: float,
    least: float = STRAIGHT,
    narrow: float | None = None,
    room: float = 1.0,
) -> tuple[Trees, Misfits]:
    """Round all bends and main lines; where something is in the way, less.

    Each curve reaches as far as its vessels allow; those of pieces that come too near to others,
    or out of the tissue, are halved until all fit.

    Parameters
    ----------
    least, narrow : float, rad
        Turns that stay as they are: of all vessels, and of those narrower than `FINE` of their
        root's radius where it is given (thousands of them in fine pieces take minutes).
    room : float
        Clearance that is made, over that asked for.

    Returns
    -------
    tuple of VesselTree
    pairs and pieces
        What is left that doesn't fit, as `misfits`.
    """
    reach = [np.ones(len(tree.parent)) for tree in trees]
    main = [main_children(tree) for tree in trees]
    forked = [np.zeros(len(tree.parent), dtype=np.bool_) for tree in trees]
    turn = [_least(tree, least, narrow) for tree in trees]
    left: list[int] = []
    for n in range(_CURVE_HALVINGS):
        curved = [curve_tree(*each) for each in zip(trees, reach, main, forked, turn, strict=True)]
        done = tuple(tree for tree, _ in curved)
        bad = misfits(tissue, done, clearance_mm, clearance_ratio, room, JOINT_RESERVE)
        wider = [_wider(*each) for each in zip(trees, curved, strict=True)]
        turned = [(a != b) & ~c for a, b, c in zip(main, wider, forked, strict=True)]
        if not _any(bad) and not any(some.any() for some in turned):
            break
        left.append(len(bad[0]) + len(bad[1]))
        if room > 1.0 and n >= _STUCK and left[-1] >= left[-1 - _STUCK]:
            break  # what is left is pushed apart next
        # Where the curve itself makes the other child wider, both are alike.
        forked = [a | b if n > 0 else a for a, b in zip(forked, turned, strict=True)]
        main = wider
        first = np.cumsum([0, *(len(tree.parent) for tree in done)])
        touched = np.zeros(first[-1], dtype=np.bool_)
        touched[bad[1]] = True
        touched[[piece for pair in bad[0] for piece in pair]] = True
        for k, (tree, (_, lines)) in enumerate(zip(trees, curved, strict=True)):
            _lower(tree, lines, touched[first[k] : first[k + 1]], reach[k])
    return done, misfits(tissue, done, clearance_mm, clearance_ratio, room)


def _least(tree: VesselTree, least: float, narrow: float | None) -> FloatArray:
    """Turn (s,), rad, up to which the main line at the end of each segment stays."""
    radius = tree_radii(tree)
    low = least if narrow is None else max(least, narrow)
    return np.where(radius < FINE * radius[0], low, least)


def misfits(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance_mm: float,
    clearance_ratio: float,
    room: float = 1.0,
    joint_part: float = 1.0,
) -> Misfits:
    """Pairs of segments nearer than the clearance, and segments that reach out of the tissue.

    Segments of all trees are numbered on. A root's segment may begin outside. Clearances count
    ``room`` times, and joints reach a little less far for it: radii may still change. So do they
    with ``joint_part``, of their reach.
    """
    part = min(joint_part, room**-0.5)
    near = collisions(forest_to_network(trees), clearance_mm, clearance_ratio, room, part)
    start = np.concatenate([tree.proximal for tree in trees])
    end = np.concatenate([tree.distal for tree in trees])
    radius = np.concatenate([tree_radii(tree) for tree in trees])
    parent = np.concatenate([tree.parent for tree in trees])
    inside = tissue.grid.capsule_inside(start, end, radius, room * clearance_mm)
    return near.vessels.tolist(), np.flatnonzero(~inside & (parent >= 0))


def _lower(tree: VesselTree, lines: Lines, bad: NDArray[np.bool_], reach: FloatArray) -> None:
    """Lower the reach of the curves that bad pieces belong to, or lie between."""
    pieces = np.flatnonzero(bad) + 1
    segment = lines.origin[pieces]
    corners = np.concatenate([lines.corner[pieces], segment, tree.parent[segment]])
    corners = np.unique(corners[corners >= 0])
    reach[corners] = np.maximum(_LESS * reach[corners], _LEAST)


def _wider(tree: VesselTree, curved: tuple[VesselTree, Lines]) -> IntArray:
    """The wider child of each segment once its tree is curved."""
    radius = np.zeros(len(tree.parent))
    radius[curved[1].origin[1:]] = tree_radii(curved[0])
    return main_children(tree, radius)


def kinks(trees: Sequence[VesselTree], degrees: float = KINK, of_root: float = WIDE) -> int:
    """Turns of main lines above an angle, in vessels wider than a part of their root's radius."""
    return len(kinked(trees, degrees, of_root))


def kinked(trees: Sequence[VesselTree], degrees: float = KINK, of_root: float = WIDE) -> IntArray:
    """Segments, numbered on, at whose end such a turn is."""
    segments, first = [], 0
    for tree in trees:
        upper, turn = turns(tree)
        radius = tree_radii(tree)
        sharp = (turn > np.radians(degrees)) & (radius[upper] > of_root * float(radius[0]))
        segments.append(upper[sharp] + first)
        first += len(tree.parent)
    return np.concatenate(segments)


# Move nodes until vessels keep their clearance and lie in the tissue.

_PUSH_ITERATIONS = 40
_MORE = 1.1
"""Clearance that is made, over that asked for."""
_SPREAD = 3
"""Pieces on either side over which a push is spread."""


def push_apart(
    tissue: Tissue,
    trees: Sequence[VesselTree],
    clearance_mm: float,
    clearance_ratio: float,
    room: float = 1.0,
) -> tuple[VesselTree, ...]:
    """The trees, their nodes moved until vessels are clear of each other, or as far as it goes.

    Of two that are too near each gives way, the thinner one more; neighbours along a vessel
    follow. Inlets stay.

    Parameters
    ----------
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`.
    room : float
        Clearance at which pushing ends, over that asked for; below `_MORE`, which is aimed at.
    """
    trees = tuple(trees)
    for _ in range(_PUSH_ITERATIONS):
        shift, worst = _pushes(trees, clearance_mm, clearance_ratio, room)
        back = _back(tissue, trees, room * clearance_mm)
        if worst <= 0.0 and not back.any():
            break
        shift += back
        first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
        trees = tuple(
            moved_tree(tree, tree.distal + _spread(tree, shift[a:b]))
            for tree, a, b in zip(trees, first[:-1], first[1:], strict=True)
        )
    return trees


def _pushes(
    trees: Sequence[VesselTree], mm: float, ratio: float, room: float
) -> tuple[FloatArray, float]:
    """How far the end of each segment, numbered on, is to move for what is near, (n, 3), mm.

    And how much the nearest pair lacks, mm; at most 0 where all are clear.
    """
    first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
    begin = np.concatenate([tree.proximal for tree in trees])
    end = np.concatenate([tree.distal for tree in trees])
    radius = np.concatenate([tree_radii(tree) for tree in trees])
    above = np.concatenate(
        [np.where(t.parent >= 0, t.parent + a, -1) for t, a in zip(trees, first[:-1], strict=True)]
    )
    shift, pushed = np.zeros_like(end), np.zeros(len(end))
    near = collisions(forest_to_network(trees), mm, ratio, _MORE, room**-0.5)
    if not near.count:
        return shift, 0.0
    one, two = near.pieces.T
    need = np.maximum(mm, ratio * np.minimum(radius[one], radius[two]))
    lack = _MORE * need - near.gap_mm
    for mine, other in ((one, two), (two, one)):
        way = end[mine] - begin[mine]
        along = np.einsum("ij,ij->i", near.place_mm - begin[mine], way)
        part = np.clip(along / np.einsum("ij,ij->i", way, way), 0.0, 1.0)
        off = begin[mine] + part[:, None] * way - near.place_mm
        off /= np.maximum(np.linalg.norm(off, axis=1), 1e-12)[:, None]
        far = lack * radius[other] / (radius[mine] + radius[other])
        far = np.minimum(far, 0.5 * radius[mine])
        for node, weight in ((mine, part), (above[mine], 1.0 - part)):
            there = node >= 0
            np.add.at(shift, node[there], (far * weight)[there, None] * off[there])
            np.add.at(pushed, node[there], weight[there])
    return shift / np.maximum(pushed, 1.0)[:, None], float((room * need - near.gap_mm).max())


def _back(tissue: Tissue, trees: Sequence[VesselTree], mm: float) -> FloatArray:
    """How far the end of each segment, numbered on, is to move into the tissue, (n, 3), mm."""
    shifts = []
    for tree in trees:
        need = tree_radii(tree) + mm
        inside = tissue.grid.capsule_inside(tree.proximal, tree.distal, need)
        out = np.flatnonzero(~inside & (tree.parent >= 0))
        wanted = np.zeros(len(need))
        for nodes in (out, tree.parent[out]):
            np.maximum.at(wanted, nodes, need[out])
        nodes = np.flatnonzero(wanted)
        lack = wanted[nodes] + tissue.grid.distance(tree.distal[nodes])
        far = np.maximum(lack, 0.03 * wanted[nodes])
        shift = np.zeros_like(tree.distal)
        shift[nodes] = -_MORE * far[:, None] * outward(tissue, tree.distal[nodes])
        shifts.append(shift)
    return np.concatenate(shifts)


def _spread(tree: VesselTree, shift: FloatArray) -> FloatArray:
    """Pushes (n, 3) of a tree's nodes spread over their neighbours; what is pushed goes as far."""
    up = np.flatnonzero(tree.parent >= 0)
    size = np.linalg.norm(shift, axis=1)
    spread = shift
    for _ in range(_SPREAD):
        total, count = spread.copy(), np.ones(len(shift))
        np.add.at(total, up, spread[tree.parent[up]])
        np.add.at(total, tree.parent[up], spread[up])
        np.add.at(count, up, 1.0)
        np.add.at(count, tree.parent[up], 1.0)
        spread = np.where(size[:, None] > 0.0, shift, total / count[:, None])
    return spread


# Remove terminals from vessel trees: first of colliding vessels, then above a wanted number.

_STEADY = 4
"""Terminals of a vessel that hardly changes when one beside it is taken away."""


def without_terminals(tree: VesselTree, gone: NDArray[np.bool_]) -> VesselTree:
    """The tree without the terminals (n,) that are gone, and without what led to these alone.

    Each terminal that stays keeps its flow; a joint of one child left becomes a bend.

    Raises
    ------
    GrowthError
        When none would stay.
    """
    if not gone.any():
        return tree
    kept = kept_segments(tree, gone)
    if not kept[0]:
        raise GrowthError("no vessel of a tree fits where its trunk runs; move its inlet")
    number = np.cumsum(kept) - 1
    a, b = tree.children[kept].T.astype(np.int64)
    a = np.where((a >= 0) & kept[np.maximum(a, 0)], number[np.maximum(a, 0)], -1)
    b = np.where((b >= 0) & kept[np.maximum(b, 0)], number[np.maximum(b, 0)], -1)
    a, b = np.where(a < 0, b, a), np.where(a < 0, -1, b)
    parent = tree.parent[kept]
    parent = np.where(parent >= 0, number[np.maximum(parent, 0)], -1)
    left = float(tree.relative_flow[kept][a < 0].sum()) * tree.terminal_flow_ul_s
    return derived_tree(
        tree,
        tree.proximal[kept],
        tree.distal[kept],
        parent,
        np.column_stack([a, b]),
        np.flatnonzero(kept),
        flow_ul_s=left,
    )


def kept_segments(tree: VesselTree, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which segments (n,) lead to a terminal that stays; the order of the rest doesn't change."""
    kept = (tree.children[:, 0] < 0) & ~gone
    for i in downward_order(tree.children)[::-1]:
        if tree.parent[i] >= 0:
            kept[tree.parent[i]] |= kept[i]
    return kept


def terminals_below(tree: VesselTree, segments: IntArray) -> NDArray[np.bool_]:
    """Which segments are terminals at or below any of ``segments``."""
    below = np.zeros(len(tree.parent), dtype=np.bool_)
    below[segments] = True
    for i in downward_order(tree.children):
        if tree.parent[i] >= 0:
            below[i] |= below[tree.parent[i]]
    below &= tree.children[:, 0] < 0
    return below


def without_collisions(
    trees: Sequence[VesselTree], pairs: list[list[int]], out: IntArray
) -> tuple[VesselTree, ...]:
    """The trees without what feeds fewer terminals of each pair, and without what is out.

    Segments of all trees are numbered on.
    """
    first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
    fed = np.concatenate([tree.terminals for tree in trees])
    bad = [min(pair, key=lambda piece: (fed[piece], piece)) for pair in pairs] + out.tolist()
    kept = []
    for n, tree in enumerate(trees):
        mine = np.array([i - first[n] for i in bad if first[n] <= i < first[n + 1]], dtype=np.int64)
        kept.append(without_terminals(tree, terminals_below(tree, mine)))
    return tuple(kept)


def trimmed(trees: Sequence[VesselTree], terminals: int) -> tuple[VesselTree, ...]:
    """The trees with so many terminals together: the shortest side branches go first.

    Each tree gives in proportion to what it has; each terminal that stays keeps its flow.
    """
    counts = np.array([int(tree.terminals[0]) for tree in trees])
    extra = int(counts.sum()) - terminals
    if extra < 0:
        raise CrowdedError(int(counts.sum()), terminals)
    goes = np.floor(extra * counts / counts.sum()).astype(np.int64)
    goes[np.argmax(counts)] += extra - int(goes.sum())
    return tuple(
        without_terminals(tree, first_tips(tree, many))
        for tree, many in zip(trees, goes.tolist(), strict=True)
    )


def first_tips(
    tree: VesselTree, many: int, stay: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """Mark ``many`` terminals (n,) that are missed least; those that must ``stay`` come last."""
    tips = _side_tips(tree)
    if stay is not None:
        tips = np.concatenate([tips[~stay[tips]], tips[stay[tips]]])
    gone = np.zeros(len(tree.parent), dtype=np.bool_)
    gone[tips[:many]] = True
    return gone


def _side_tips(tree: VesselTree) -> IntArray:
    """Terminals by how little is lost with them: first those that leave a wider vessel.

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
    side = (radius[top] < radius[beside]) & (tree.terminals[beside] >= _STEADY)
    rank = np.where(tree.given[tips], 2, np.where(side & (tree.parent[top] >= 0), 0, 1))
    return np.asarray(tips[np.lexsort((total, rank))], dtype=np.int64)


def with_flow(tree: VesselTree, terminal_flow_ul_s: float) -> VesselTree:
    """Return the tree with another mean flow of its terminals; radii follow from the drop."""
    return replace(tree, terminal_flow_ul_s=terminal_flow_ul_s)
