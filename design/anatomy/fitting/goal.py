"""Goal that vessels are fitted to: flows, clearances, and what still misfits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from design.tissue import Tissue
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
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


class Segments(NamedTuple):
    """Segments of all trees, numbered on; each tree's ``first`` one, and how many there are."""

    begin: FloatArray
    end: FloatArray
    radius: FloatArray
    parent: IntArray
    fed: IntArray  # terminals downstream
    given: BoolArray  # trunks
    first: IntArray

    @staticmethod
    def of(trees: Sequence[VesselTree]) -> Segments:
        """Join trees."""
        first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
        parents = [
            np.where(t.parent >= 0, t.parent + a, -1)
            for t, a in zip(trees, first[:-1], strict=True)
        ]
        return Segments(
            np.concatenate([tree.proximal for tree in trees]),
            np.concatenate([tree.distal for tree in trees]),
            np.concatenate([tree_radii(tree) for tree in trees]),
            np.concatenate(parents),
            np.concatenate([tree.terminals for tree in trees]),
            np.concatenate([tree.given for tree in trees]),
            first,
        )


def reaching_out(tissue: Tissue, every: Segments, mm: float) -> IntArray:
    """Find segments, trunks' first ones aside, that come nearer than ``mm`` to the surface."""
    inside = tissue.grid.capsule_inside(every.begin, every.end, every.radius, mm)
    return np.flatnonzero(~inside & (every.parent >= 0))
