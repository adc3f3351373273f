"""Terminals that connecting vessels may start from: end point, directions, shortening so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from design.vasculature.loops.curve_fit import KIN
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray, IntArray

_TURNS = np.array([0.0, 60.0, -60.0, 120.0, -120.0, 180.0])
"""Around a connection, from the direction in which the other end lies, degrees."""


@dataclass(frozen=True)
class Tips:
    """Terminals of one side, arterial or venous.

    Attributes
    ----------
    point, direction : (n, 3) float64
        mm, and unit vectors.
    kin : (n, KIN) int64
        See `Ends`.
    way : (n, KIN) float64, mm
    length, radius : (n,) float64, mm
        Of the terminal's vessel as grown.
    drawn_back : (n,) float64, mm
        By how much it was shortened since.
    mixing : bool
        Ends on other connections: their directions are those connections' own, which a new one
        leaves sideways.
    """

    point: FloatArray
    direction: FloatArray
    kin: IntArray
    way: FloatArray
    length: FloatArray
    radius: FloatArray
    drawn_back: FloatArray
    mixing: bool = False

    def draw_back(self, tip: int, by: float) -> None:
        """Shorten a terminal's vessel by ``by`` (mm; negative gives back)."""
        self.point[tip] -= by * self.direction[tip]
        self.way[tip, 1:] -= by
        self.drawn_back[tip] += by

    def lost(self, tip: int) -> float:
        """Length over r⁴ that a terminal has lost, mm⁻³."""
        return float(self.drawn_back[tip] / self.radius[tip] ** 4)

    def towards(self, tip: int, place: FloatArray) -> FloatArray:
        """Unit vectors (k, 3) in which a connection to ``place`` may leave, the best first."""
        ahead: FloatArray = self.direction[tip]
        if not self.mixing:
            return ahead[None]
        way = place - self.point[tip]
        sideways = way - (way @ ahead) * ahead
        size = float(np.linalg.norm(sideways))
        if size < 1e-9 * float(np.linalg.norm(way)):
            sideways = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
            size = float(np.linalg.norm(sideways))
        turn = np.radians(_TURNS)[:, None]
        ways: FloatArray = (
            np.cos(turn) * sideways / size + np.sin(turn) * np.cross(ahead, sideways) / size
        )
        return ways


def tree_tips(tree: VesselTree, first: int) -> Tips:
    """The terminals of a tree whose segments are numbered from ``first`` on."""
    tip = np.flatnonzero(tree.children[:, 0] < 0)
    span = tree.distal[tip] - tree.proximal[tip]
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    parent = tree.parent[tip].astype(np.int64)
    above = np.where(parent >= 0, tree.parent[parent], -1).astype(np.int64)
    kin = np.full((len(tip), KIN), -1, dtype=np.int64)
    way = np.zeros((len(tip), KIN))
    kin[:, 0] = tip
    kin[:, 1], kin[:, 2] = parent, _sibling(tree, tip, parent)
    kin[:, 3] = above
    kin[:, 4] = np.where(parent >= 0, _sibling(tree, parent, above), -1)
    way[:, 1:3] = length[tip, None]
    way[:, 3:] = (length[tip] + length[parent])[:, None]
    return Tips(
        tree.distal[tip],
        span / length[tip, None],
        np.where(kin >= 0, kin + first, -1),
        way,
        length[tip],
        tree_radii(tree)[tip],
        np.zeros(len(tip)),
    )


def _sibling(tree: VesselTree, segment: IntArray, parent: IntArray) -> IntArray:
    """The other child of each parent, -1 where there is no parent."""
    other = tree.children[parent].sum(axis=1) - segment
    return np.where(parent >= 0, other, -1).astype(np.int64)


def join_tips(tips: Sequence[Tips]) -> Tips:
    """The tips of several trees as one side."""
    names = [f.name for f in fields(Tips) if f.name != "mixing"]
    columns: dict[str, Any] = {n: np.concatenate([getattr(t, n) for t in tips]) for n in names}
    return Tips(**columns)
