"""Push colliding vessel trees apart, curve them, and prune to a given number of terminals."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import ceil

import numpy as np
from numpy.typing import NDArray

from design.anatomy.curves import STRAIGHT, Lines, curve_tree, main_children, turns
from design.anatomy.push_apart import (
    first_tips,
    kept_segments,
    push_apart,
    terminals_below,
    trimmed,
    with_flow,
    without_collisions,
    without_terminals,
)
from design.anatomy.trunk_depth import check_trunks, risen_trees, sink_trunk
from design.errors import CrowdedError, GrowthError
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.growth.forest import forest_to_network
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
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
    raise GrowthError(
        f"{len(bad[0])} pairs of vessels are too near, {len(bad[1])} pieces out of the tissue and "
        f"{kinks(final)} kinks are left after {AGAIN} rounds; ask for fewer terminals or a higher "
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
ROUNDS = 10
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
    raise GrowthError(
        f"{len(bad[0])} pairs of vessels are too near, {len(bad[1])} pieces out of the tissue and "
        f"{kinks(done)} kinks are left after {AGAIN} rounds; ask for fewer terminals or a higher "
        "pressure_drop_mmhg"
    )


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
    for n in range(ROUNDS):
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
