"""Compare grown trunks with planned main branches, and radii with published ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.curves import curved_network
from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.organ import Trees, grow_fitted
from design.anatomy.perforators import pieces_along
from design.anatomy.trunk_lines import TrunkLines
from design.errors import GrowthError, WideTrunkError
from design.geometry.polyline import arc_lengths, places_along
from design.measures.published_comparison import PublishedMatch, published_match
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray, IntArray

_NEAR: Final = 0.03
"""Of all planned branches' extent: so far from its planned way a branch may lie, made smooth.
Trunks that are wide for their organ lie deeper by their radius."""
_WHOLE: Final = 0.8
"""Of a branch's planned way, below which it is told."""
_LOST: Final = 0.3
"""Of the planned way of a branch that an organ needs, below which it is lost. Ours."""
_NARROWER: Final = 1.5
"""On the pressure drop, tried where a branch is lost; radii fall by a tenth."""
_SAME_WAY: Final = 0.5
"""Cosine between a vessel and the planned way beside it, from which on it follows that."""
_FINE: Final = 0.25
"""Of how near a trunk must be: places that are compared lie so far apart."""


class MainBranch(NamedTuple):
    """A branch with a name of its own.

    Attributes
    ----------
    name : str
    tree : int
        That it belongs to.
    line : (n, 3) float64, mm
        Its planned way.
    needed : bool
        Whether the organ can't be without it.
    """

    name: str
    tree: int
    line: FloatArray
    needed: bool = False


class Pieces(NamedTuple):
    """Pieces of a tree's trunks: where they begin and end (n, 3), radii (n,), mm, and parents (n,).

    A parent is the number of the piece before, -1 where there is none.
    """

    begin: FloatArray
    end: FloatArray
    radius: FloatArray
    parent: IntArray


def trunk_pieces(trees: Trees) -> list[Pieces]:
    """Of each tree, its trunks."""
    pieces = []
    for tree in trees:
        mine = np.flatnonzero(tree.given)
        parent = _renumbered(mine, tree.parent[mine].astype(np.int64), len(tree.parent))
        wide = tree_radii(tree)[mine]
        pieces.append(Pieces(tree.proximal[mine], tree.distal[mine], wide, parent))
    return pieces


def line_pieces(lines: TrunkLines, radius: FloatArray) -> list[Pieces]:
    """Of each tree, its lines, whose nodes have radii (n,), mm."""
    pieces = []
    for tree in np.unique(lines.tree):
        ends = np.flatnonzero((lines.tree == tree) & (lines.parent >= 0))
        above = lines.parent[ends]
        parent = _renumbered(ends, above, len(lines.parent))
        pieces.append(Pieces(lines.points[above], lines.points[ends], radius[ends], parent))
    return pieces


def _renumbered(mine: IntArray, parent: IntArray, count: int) -> IntArray:
    """Parents by the numbers of ``mine`` among themselves, -1 where they aren't among them."""
    number = np.full(count + 1, -1, dtype=np.int64)
    number[mine] = np.arange(len(mine))
    return np.asarray(number[np.where(parent < 0, count, parent)])


def _followed(pieces: Pieces, places: FloatArray, near_mm: float) -> float:
    """Greatest part of a line's places (k, 3) that one way from root to tip goes along.

    Where its wall lies within ``near_mm`` of a place and it leads the same way at about.
    """
    ahead = np.gradient(places, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1), 1e-12)[:, None]
    way = pieces.end - pieces.begin
    there, row = pieces_along(pieces.begin, pieces.end, _FINE * near_mm)
    found = cKDTree(places).query_ball_point(there, near_mm + pieces.radius[row])
    along = (way @ ahead.T > _SAME_WAY * np.linalg.norm(way, axis=1)[:, None]).tolist()
    passed = [0] * len(way)
    for piece, some in zip(row.tolist(), found, strict=True):
        for place in some:
            if along[piece][place]:
                passed[piece] |= 1 << place
    return _most_on_one_way(passed, pieces.parent) / len(places)


def _most_on_one_way(passed: list[int], parent: IntArray) -> int:
    """Most bits set among all that the pieces of one way from root to tip have ``passed``."""
    children: list[list[int]] = [[] for _ in passed]
    below: list[int] = []
    for piece, above in enumerate(parent.tolist()):
        (children[above] if above >= 0 else below).append(piece)
    most = 0
    so_far = dict.fromkeys(below, 0)
    while below:
        piece = below.pop()
        done = so_far.pop(piece) | passed[piece]
        most = max(most, done.bit_count())
        below += children[piece]
        so_far |= dict.fromkeys(children[piece], done)
    return most


class _Share(NamedTuple):
    """How much of a branch's planned way of ``length_mm`` is laid, 0 to 1."""

    branch: MainBranch
    laid: float
    length_mm: float


def missing_branches(branches: tuple[MainBranch, ...], laid: list[Pieces]) -> tuple[str, ...]:
    """Return a note for each branch that one vessel of its tree follows less than 0.8 of the way.

    What lies beside the rest of it, as side branches do, is another vessel.
    """
    return tuple(
        f"the {one.branch.name} lies along {one.laid:.0%} of its planned {one.length_mm:.0f} mm: "
        "the rest found no room; a higher pressure_drop_mmhg or fewer trunk_ends leave it more"
        for one in _shares(branches, laid)
        if one.laid < _WHOLE
    )


def lost_branch(branches: tuple[MainBranch, ...], laid: list[Pieces]) -> WideTrunkError | None:
    """What is to be raised where a branch that the organ can't be without is lost."""
    for one in _shares(branches, laid):
        if one.branch.needed and one.laid < _LOST:
            x, y, z = one.branch.line[0]
            return WideTrunkError(
                f"the {one.branch.name} finds no room: as wide as it is, it lies along "
                f"{one.laid:.0%} of the {one.length_mm:.0f} mm planned from ({x:.4g}, {y:.4g}, "
                f"{z:.4g}) mm on",
                drop_factor=_NARROWER,
            )
    return None


def _shares(branches: tuple[MainBranch, ...], trunks: list[Pieces]) -> list[_Share]:
    """How much of each branch of some length is laid."""
    ways = [branch.line for branch in branches if len(branch.line) > 1]
    if not ways:
        return []
    extent = float(np.linalg.norm(np.ptp(np.concatenate(ways), axis=0)))
    near = _NEAR * extent
    shares = []
    for branch in branches:
        places, length = _along(branch.line, _FINE * near)
        if len(places):
            there = _followed(trunks[branch.tree], places, near)
            shares.append(_Share(branch, there, length))
    return shares


def _along(line: FloatArray, step_mm: float) -> tuple[FloatArray, float]:
    """Places (k, 3) along a line, ``step_mm`` apart at most, and its length, mm."""
    way = arc_lengths(line)
    if way[-1] <= 0.0:
        return np.empty((0, 3)), 0.0
    at = np.linspace(0.0, way[-1], int(np.ceil(way[-1] / step_mm)) + 1)
    return places_along(line, way, at), float(way[-1])


# Match a heart's radii to published ones by other pressure drops.

_DROPS: Final = 3
"""Other pressure drops that are tried at most."""
LAID: Final = 0.85
"""Of the planned trunks' length, below which it is told: smoothed they are a twentieth shorter. Of
the length with the given pressure drop, which another drop must keep."""
_REACH: Final = 1.15
"""Distance from the nearest terminal, of 99 % of the tissue, with another pressure drop over that
with the given one, at most: no part may lose its supply for nearer radii."""


def with_published_radii(
    trees: Trees,
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    branches: tuple[MainBranch, ...],
    volume: FloatArray,
) -> Trees:
    """Trees as they are where their radii are the published ones, else grown with another drop.

    Trees that don't fit then, lack trunks, a main branch or supply of some places of ``volume``, or
    are farther from the table aren't taken; half of the change is tried then. There are some
    already, so that vessels that find no room aren't tried again from other random numbers.
    """
    once, least = replace(plan, tries=1), LAID * trunks_mm(trees)
    most_mm = _REACH * _reach_mm(volume, trees)
    match = _published_match(trees)
    factor = match.factor
    for _ in range(_DROPS):
        if factor == 1.0:
            break
        drop = trees[0].pressure_drop_pa / factor**4
        other = _grown_with(tissue, once, replace(options, pressure_drop_pa=drop))
        found = match if other is None else _published_match(other)
        # Wider trunks that cost many branches aren't worth nearer figures.
        if (
            other is None
            or lost_branch(branches, trunk_pieces(other)) is not None
            or trunks_mm(other) <= least
            or _reach_mm(volume, other) > most_mm
            or found.farthest_sd >= match.farthest_sd
            or _missing(branches, other) > _missing(branches, trees)
        ):
            factor = factor**0.5
        else:
            trees, match, factor = other, found, found.factor
    return trees


def _reach_mm(volume: FloatArray, trees: Trees) -> float:
    """Way, mm, from the nearest terminal within which 99 % of places (n, 3) lie."""
    ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
    return float(np.percentile(cKDTree(ends).query(volume)[0], 99.0))


def _missing(branches: tuple[MainBranch, ...], trees: Trees) -> int:
    return len(missing_branches(branches, trunk_pieces(trees)))


def _grown_with(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees | None:
    """Trees, or None where they don't fit."""
    try:
        return grow_fitted(tissue, plan, options)
    except GrowthError:
        return None


def _published_match(trees: Sequence[VesselTree]) -> PublishedMatch:
    kinds = (VesselKind.ARTERY,) * len(trees)
    return published_match(curved_network(trees, kinds), "coronary")


def trunks_mm(trees: Trees) -> float:
    """Length of all trunks, mm."""
    pieces = np.concatenate([(tree.distal - tree.proximal)[tree.given] for tree in trees])
    return float(np.linalg.norm(pieces, axis=1).sum())
