"""Compare laid and grown trunks with the planned ways of an organ's main branches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.perforators import pieces_along
from design.anatomy.trunk_lines import TrunkLines
from design.errors import WideTrunkError
from design.geometry.polyline import arc_lengths, places_along
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


def trunk_pieces(trees: tuple[VesselTree, ...]) -> list[Pieces]:
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


def check_main_branches(branches: tuple[MainBranch, ...], laid: list[Pieces]) -> None:
    """Raise if a branch that the organ can't be without lies along too little of its way.

    Raises
    ------
    WideTrunkError
    """
    for one in _shares(branches, laid):
        if one.branch.needed and one.laid < FOLLOWED.lost:
            x, y, z = one.branch.line[0]
            raise WideTrunkError(
                f"the {one.branch.name} finds no room: as wide as it is, it lies along "
                f"{one.laid:.0%} of the {one.length_mm:.0f} mm planned from ({x:.4g}, {y:.4g}, "
                f"{z:.4g}) mm on",
                drop_factor=FOLLOWED.narrower,
            )


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
