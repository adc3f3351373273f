"""Compare grown trunks with planned main branches, and radii with published ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.curves import curved_network
from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.organ import Trees, grow_trees
from design.anatomy.perforators import pieces_along
from design.anatomy.trunk_lines import TrunkLines
from design.errors import GrowthError, WideTrunkError
from design.geometry.polyline import arc_lengths, places_along
from design.measures.published_comparison import PublishedMatch, published_match
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_radii
from kernels.arrays import FloatArray, IntArray


class _Followed(NamedTuple):
    """When a trunk follows the planned way of a main branch. Ours."""

    near: float = 0.03  # of all ways' extent: how far from it a wall lies; bends are smoothed
    fine: float = 0.25  # of that: distance of compared places
    same_way: float = 0.5  # cosine between vessel and way, at least
    whole: float = 0.8  # of the way, below which a branch is named in the notes
    lost: float = 0.3  # of the way of a needed branch, below which it is lost
    narrower: float = 1.5  # on the pressure drop, tried where one is lost; radii fall by a tenth


FOLLOWED = _Followed()


class MainBranch(NamedTuple):
    """A branch with a name of its own."""

    name: str
    tree: int  # that it belongs to
    line: FloatArray  # (n, 3), mm, its planned way
    needed: bool = False  # whether the organ can't be without it


class Pieces(NamedTuple):
    """Pieces of a tree's trunks, parents before their children."""

    begin: FloatArray  # (n, 3), mm
    end: FloatArray
    radius: FloatArray  # (n,), mm
    parent: IntArray  # (n,), the piece before, -1 where there is none


def trunk_pieces(trees: Trees) -> list[Pieces]:
    """Return the trunks of each tree."""
    pieces = []
    for tree in trees:
        order = downward_order(tree.children)
        mine = order[tree.given[order]]
        pieces.append(_pieces(tree.proximal, tree.distal, tree_radii(tree), tree.parent, mine))
    return pieces


def line_pieces(lines: TrunkLines, radius: FloatArray) -> list[Pieces]:
    """Return the pieces of each tree's lines, whose nodes have radii (n,), mm."""
    begin, inner = lines.points[lines.parent], lines.parent >= 0
    return [
        _pieces(begin, lines.points, radius, lines.parent, np.flatnonzero(inner & mine))
        for mine in (lines.tree == tree for tree in np.unique(lines.tree))
    ]


def _pieces(
    begin: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    parent: NDArray[np.integer],
    mine: NDArray[np.integer],
) -> Pieces:
    number = np.full(len(parent) + 1, -1, dtype=np.int64)  # the last one stands for no parent
    number[mine] = np.arange(len(mine))
    return Pieces(begin[mine], end[mine], radius[mine], number[parent[mine]])


def _followed(pieces: Pieces, places: FloatArray, near_mm: float) -> float:
    """Return the greatest part of a line's places (k, 3) that one way from root to tip goes along.

    Where its wall lies within ``near_mm`` of a place and it leads the same way at about.
    """
    ahead = np.gradient(places, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1), 1e-12)[:, None]
    way = pieces.end - pieces.begin
    there, row = pieces_along(pieces.begin, pieces.end, FOLLOWED.fine * near_mm)
    near = cKDTree(places).query_ball_point(there, near_mm + pieces.radius[row])
    along = way @ ahead.T > FOLLOWED.same_way * np.linalg.norm(way, axis=1)[:, None]
    beside = np.zeros_like(along)
    for piece, some in zip(row, near, strict=True):
        beside[piece, some] = True
    passed, most = beside & along, 0
    for piece, above in enumerate(pieces.parent.tolist()):
        if above >= 0:
            passed[piece] |= passed[above]
        most = max(most, int(passed[piece].sum()))
    return most / len(places)


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
        if one.laid < FOLLOWED.whole
    )


def lost_branch(branches: tuple[MainBranch, ...], laid: list[Pieces]) -> WideTrunkError | None:
    """Return what is to be raised where a branch that the organ can't be without is lost."""
    for one in _shares(branches, laid):
        if one.branch.needed and one.laid < FOLLOWED.lost:
            x, y, z = one.branch.line[0]
            return WideTrunkError(
                f"the {one.branch.name} finds no room: as wide as it is, it lies along "
                f"{one.laid:.0%} of the {one.length_mm:.0f} mm planned from ({x:.4g}, {y:.4g}, "
                f"{z:.4g}) mm on",
                drop_factor=FOLLOWED.narrower,
            )
    return None


def _shares(branches: tuple[MainBranch, ...], trunks: list[Pieces]) -> list[_Share]:
    """Return how much of each branch of some length is laid."""
    ways = [branch.line for branch in branches if len(branch.line) > 1]
    if not ways:
        return []
    near = FOLLOWED.near * float(np.linalg.norm(np.ptp(np.concatenate(ways), axis=0)))
    shares = []
    for branch in branches:
        way = arc_lengths(branch.line)
        length = float(way[-1])
        if length > 0.0:
            at = np.linspace(0.0, length, int(np.ceil(length / (FOLLOWED.fine * near))) + 1)
            places = places_along(branch.line, way, at)
            shares.append(_Share(branch, _followed(trunks[branch.tree], places, near), length))
    return shares


# Match a heart's radii to published ones by other pressure drops.


class _Match(NamedTuple):
    """What another pressure drop mustn't cost for radii nearer to the published ones."""

    drops: int = 3  # that are tried at most
    # Of the trunks' length, that it must keep; of the planned length, below which the notes say so:
    # smoothed they are a twentieth shorter.
    laid: float = 0.85
    reach: float = 1.15  # distance of 99 % of the tissue from a terminal over that before


MATCH = _Match()


def with_published_radii(
    trees: Trees,
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    branches: tuple[MainBranch, ...],
    volume: FloatArray,
) -> Trees:
    """Return trees whose radii are the published ones, else others grown with another drop.

    Trees that don't fit then, lack trunks, a main branch or supply of some places of ``volume``, or
    are farther from the table aren't taken; half of the change is tried then. There are some
    already, so that vessels that find no room aren't tried again from other random numbers.
    """
    once, least = replace(plan, tries=1), MATCH.laid * trunks_mm(trees)
    most_mm = MATCH.reach * _reach_mm(volume, trees)
    missing = len(missing_branches(branches, trunk_pieces(trees)))
    match = _published_match(trees)
    factor = match.factor
    for _ in range(MATCH.drops):
        if factor == 1.0:
            break
        drop = trees[0].pressure_drop_pa / factor**4
        factor = factor**0.5
        try:
            other = grow_trees(tissue, once, replace(options, pressure_drop_pa=drop))
        except GrowthError:
            continue
        found, laid = _published_match(other), trunk_pieces(other)
        lost = len(missing_branches(branches, laid))
        # Wider trunks that cost many branches aren't worth nearer figures.
        if (
            lost_branch(branches, laid) is None
            and trunks_mm(other) > least
            and _reach_mm(volume, other) <= most_mm
            and found.farthest_sd < match.farthest_sd
            and lost <= missing
        ):
            trees, match, factor, missing = other, found, found.factor, lost
    return trees


def _reach_mm(volume: FloatArray, trees: Trees) -> float:
    """Return the way, mm, from the nearest terminal within which 99 % of places (n, 3) lie."""
    ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
    return float(np.percentile(cKDTree(ends).query(volume)[0], 99.0))


def _published_match(trees: Sequence[VesselTree]) -> PublishedMatch:
    kinds = (VesselKind.ARTERY,) * len(trees)
    return published_match(curved_network(trees, kinds), "coronary")


def trunks_mm(trees: Trees) -> float:
    """Return the length of all trunks, mm."""
    pieces = np.concatenate([(tree.distal - tree.proximal)[tree.given] for tree in trees])
    return float(np.linalg.norm(pieces, axis=1).sum())
