"""List an organ's named main branches of which the grown trunks cover less than 80 %."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.grown import Trees
from design.anatomy.trunk_lines import TrunkLines
from design.errors import WideTrunkError
from design.geometry.polyline import arc_lengths, places_along
from design.vasculature.treemath import tree_radii
from kernels.arrays import BoolArray, FloatArray

_NEAR: Final = 0.03
"""Of all planned branches' extent: so far from its planned way a branch may lie, made smooth.
Trunks that are wide for their organ lie deeper by their radius."""
_WHOLE: Final = 0.8
"""Of a branch's planned way, below which it is told."""
_LOST: Final = 0.3
"""Of the planned way of a branch that an organ needs, below which it is lost. Ours."""
_NARROWER: Final = 1.5
"""On the pressure drop, tried where a branch is lost; radii fall by a tenth."""
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
    """Pieces of a tree's trunks: where they begin and end (n, 3), and their radii (n,), mm."""

    begin: FloatArray
    end: FloatArray
    radius: FloatArray


def trunk_pieces(trees: Trees) -> list[Pieces]:
    """Of each tree, its trunks."""
    return [
        Pieces(tree.proximal[tree.given], tree.distal[tree.given], tree_radii(tree)[tree.given])
        for tree in trees
    ]


def line_pieces(lines: TrunkLines, radius: FloatArray) -> list[Pieces]:
    """Of each tree, its lines, whose nodes have radii (n,), mm."""
    pieces = []
    for tree in np.unique(lines.tree):
        ends = np.flatnonzero((lines.tree == tree) & (lines.parent >= 0))
        begin = lines.points[lines.parent[ends]]
        pieces.append(Pieces(begin, lines.points[ends], radius[ends]))
    return pieces


class _Laid(NamedTuple):
    """Places along a tree's trunks, and the radius at each, mm."""

    places: cKDTree
    radius: FloatArray

    @staticmethod
    def of(pieces: Pieces, step_mm: float) -> _Laid:
        begin, end, wide = pieces
        count = np.ceil(np.linalg.norm(end - begin, axis=1) / step_mm).astype(np.int64) + 1
        row = np.repeat(np.arange(len(count)), count)
        number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        share = (number / np.maximum(count - 1, 1)[row])[:, None]
        return _Laid(cKDTree(begin[row] + share * (end - begin)[row]), wide[row])

    def is_near(self, places: FloatArray, near_mm: float) -> BoolArray:
        """Whether a trunk's wall lies so near to each place (k, 3)."""
        away, row = self.places.query(places)
        return np.asarray(away < near_mm + self.radius[row])


class _Share(NamedTuple):
    """How much of a branch's planned way of ``length_mm`` is laid, 0 to 1."""

    branch: MainBranch
    laid: float
    length_mm: float


def missing_branches(branches: tuple[MainBranch, ...], laid: list[Pieces]) -> tuple[str, ...]:
    """Return a note for each branch along less than 0.8 of whose way a trunk of its tree lies."""
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
    laid = [_Laid.of(pieces, _FINE * near) for pieces in trunks]
    shares = []
    for branch in branches:
        places, length = _along(branch.line, _FINE * near)
        if len(places):
            there = float(laid[branch.tree].is_near(places, near).mean())
            shares.append(_Share(branch, there, length))
    return shares


def _along(line: FloatArray, step_mm: float) -> tuple[FloatArray, float]:
    """Places (k, 3) along a line, ``step_mm`` apart at most, and its length, mm."""
    way = arc_lengths(line)
    if way[-1] <= 0.0:
        return np.empty((0, 3)), 0.0
    at = np.linspace(0.0, way[-1], int(np.ceil(way[-1] / step_mm)) + 1)
    return places_along(line, way, at), float(way[-1])
