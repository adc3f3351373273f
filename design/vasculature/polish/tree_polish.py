"""Optimise one tree among others in compiled steps: move branch points, graft, repair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from design.tissue import Tissue
from design.vasculature.growth.audit import measure_allowed_radii
from design.vasculature.growth.clearances import Clearances
from design.vasculature.growth.index import CellIndex, empty_index
from design.vasculature.growth.settling import settle_root
from design.vasculature.growth.step import list_all
from design.vasculature.limits import joint_limits
from design.vasculature.options import Law
from design.vasculature.polish.cost import law_of, segments_of
from design.vasculature.polish.graft import graft
from design.vasculature.polish.options import PolishOptions
from design.vasculature.polish.relax import relax
from design.vasculature.polish.repair import push_wide
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_from_topology
from kernels.arrays import FloatArray, IntArray

RESERVES = (1.01, 1.003)
"""Moves must fit with so much larger radii: in the first sweeps of a relaxation, in later ones."""

TOUCH = 1.0005
"""What is pushed aside must fit with so much larger radii."""

BETWEEN = 2
"""Sweeps between two rounds of grafting, at most."""

COLD = 3
"""Last rounds, in which no graft may raise the cost."""

MENDINGS = 8
"""Audits and repairs after a sweep, at most."""

HALVINGS = 2
"""How often a sweep that can't be repaired is tried with half of its moves."""

PARTS, PART = 8, 2500
"""Parts, at most, in which branches are grafted between audits, and branches in one at least."""

ANYWHERE = 1e3
"""Heat at which a branch that can't stay is grafted wherever it fits."""

_CELL = 1.2


@dataclass
class Bench:
    """A tree on the bench: its segments, the room it has, and what was done to it.

    ``segments`` holds the tree's own ``count``, then those of other trees, which stay as they are.
    """

    tissue: Tissue
    given: VesselTree
    options: PolishOptions
    law: Law
    room: Clearances
    flow_over_drop: float
    segments: NDArray[np.void]
    count: int
    index: CellIndex
    random: np.random.Generator
    most_wide: int = 0
    node_moves: int = 0
    graft_moves: int = 0
    rejected: int = 0

    @classmethod
    def open(
        cls,
        tissue: Tissue,
        tree: VesselTree,
        options: PolishOptions,
        others: Sequence[VesselTree] = (),
    ) -> Bench:
        """Lay a tree out, beside others."""
        law = law_of(tree, options.length_exponent, options.radius_exponent)
        grid = tissue.grid
        room = Clearances(
            grid.arrays,
            options.clearance_mm,
            options.clearance_mm,
            options.clearance_ratio,
            options.length_to_radius,
            RESERVES[0],
            joint_limits(
                options.branch_angle_degrees, options.turn_angle_degrees, options.flow_ratio
            ),
            np.inf,
        )
        flow = tree.terminal_flow_ul_s * int(tree.terminals[0])
        bench = cls(
            tissue,
            tree,
            options,
            law,
            room,
            flow / tree.pressure_drop_pa,
            np.concatenate([segments_of(tree, law), *(_fixed(one, law) for one in others)]),
            len(tree.parent),
            empty_index(tissue.bounds, float(np.ptp(tissue.bounds)), 1, 1),
            np.random.default_rng(options.seed),
        )
        bench.most_wide = bench.audit()
        return bench

    @property
    def cost(self) -> float:
        """K_root of the tree as it stands."""
        return float(self.segments["spend"][0])

    def run(self) -> float:
        """Relax, then graft and relax in turn; the cost's ratio after the first relaxation."""
        if self.count < 5:
            return 1.0
        start = self.cost
        self.relax(self.options.sweeps)
        relaxed, best = self.cost, self.segments.copy()
        for heat in _cooling(self.options.rounds, self.options.heat):
            before = self.cost
            self.graft(heat)
            self.relax(BETWEEN)
            if heat == 0 and self.cost > before * (1.0 - self.options.tolerance):
                break
        if self.options.rounds:
            self.relax(self.options.sweeps)
        if self.cost > relaxed:
            self.segments = best
        return relaxed / start

    def relax(self, sweeps: int) -> None:
        """Sweep until the cost hardly falls."""
        for sweep in range(sweeps):
            before = self.cost
            self.room = self.room._replace(reserve=RESERVES[min(sweep // 2, 1)])
            self.node_moves += self._kept(partial(self._relax, sweep), before, self._all())
            if self.cost > before * (1.0 - self.options.tolerance):
                break

    def graft(self, heat: float) -> None:
        """Try to graft every branch once, in random order, and mend after each part of them."""
        branches = self.random.permutation(self._all())
        for part in np.array_split(branches, min(PARTS, 1 + len(branches) // PART)):
            limit = np.inf if heat else self.cost
            self.graft_moves += self._kept(partial(self._graft, heat), limit, part)

    def tree(self) -> VesselTree:
        """The tree as it stands, its ratios computed afresh."""
        s, given = self.segments[: self.count], self.given
        return tree_from_topology(
            np.column_stack([s["px"], s["py"], s["pz"]]),
            np.column_stack([s["dx"], s["dy"], s["dz"]]),
            s["parent"],
            np.column_stack([s["left"], s["right"]]),
            flow_ul_s=given.terminal_flow_ul_s * int(given.terminals[0]),
            pressure_drop_pa=given.pressure_drop_pa,
            murray_exponent=given.murray_exponent,
            viscosity_pa_s=given.viscosity_pa_s,
            relative_flow=s["flow"],
            haematocrit=given.haematocrit,
        )

    def _all(self) -> IntArray:
        return np.arange(1, self.count)

    def _kept(self, stage: Callable[[IntArray], int], limit: float, segments: IntArray) -> int:
        """Run a stage on segments; where that can't be repaired, on half of them, and so on.

        Returns how many of its moves are kept: all, or none where the cost doesn't end below
        ``limit``.
        """
        before = self.segments.copy()
        for _ in range(HALVINGS + 1):
            moved = stage(segments)
            if moved == 0 or (self.mended() and self.cost < limit):
                return moved
            self.rejected += moved
            self.segments = before.copy()
            self.audit()
            segments = self.random.permutation(segments)[: len(segments) // 2]
        return 0

    def mended(self) -> bool:
        """Audit with the true radii and mend what doesn't fit; False when something is left.

        Branch points are pushed aside; where that doesn't help, branches are grafted elsewhere.
        """
        for attempt in range(MENDINGS):
            if self.audit() <= self.most_wide:
                return True
            if attempt % 2 == 0:
                self._push()
            else:
                self._through(self._smaller_of_wide(), ANYWHERE)
        return self.audit() <= self.most_wide

    def _push(self) -> None:
        room = self.room._replace(reserve=TOUCH)
        full = True
        while full:
            _, full = push_wide(self.segments, self.index, room, self.law, self.flow_over_drop)
            if full:
                self._list()

    def _smaller_of_wide(self) -> IntArray:
        """Of the segments that are too wide, which come in pairs, those that feed fewer."""
        s = self.segments[: self.count]
        wide = np.flatnonzero(s["radius"] > s["allowed"])
        wide = wide[wide > 0]
        fed = s["terminals"][wide]
        order = np.argsort(fed, kind="stable")
        return wide[order[: (len(order) + 1) // 2]]

    def audit(self) -> int:
        """Derive radii and the room of each segment; how many are too wide."""
        settle_root(self.segments, self.count, self.flow_over_drop, 1.0, self.law)
        self._list()
        wide = measure_allowed_radii(self.segments, self.count, self.index, self.room, 0.0, True)
        self.segments["allowed"][self.count :] = np.inf
        return int(wide)

    def _list(self) -> None:
        """List all segments in an empty index."""
        count = len(self.segments)
        volume = float(np.prod(np.ptp(self.tissue.bounds, axis=0)))
        cell = _CELL * float(np.cbrt(min(self.tissue.volume_mm3, volume) / max(8, count // 2)))
        room = 24 * count + 4096
        while True:
            self.index = empty_index(self.tissue.bounds, cell, room, count)
            listed = list_all(self.segments, count, self.index, self.room)
            if listed and self.index.used[0] < 0.5 * room:
                return
            room *= 2

    def _relax(self, sweep: int, segments: IntArray) -> int:
        own = self.segments[: self.count]
        order = downward_order(np.column_stack([own["left"], own["right"]]))
        chosen = np.zeros(len(order), dtype=bool)
        chosen[segments] = self.segments["left"][segments] >= 0
        nodes = order[chosen[order]]
        if sweep % 2:
            nodes = nodes[::-1].copy()
        turn = float(self.random.uniform(0.0, 2.0 * np.pi))
        first = total = 0
        while first < len(nodes):
            first, moved = relax(*self._tools, nodes, first, turn)
            total += moved
            if first < len(nodes):
                self._list()
        return total

    def _graft(self, heat: float, branches: IntArray) -> int:
        return self._through(branches, heat)

    def _through(self, branches: IntArray, heat: float) -> int:
        first = total = 0
        while first < len(branches):
            first, moved = graft(*self._tools, branches, first, heat)
            total += moved
            if first < len(branches):
                self._list()
        return total

    @property
    def _tools(self) -> tuple[NDArray[np.void], CellIndex, Clearances, Law, float]:
        return self.segments, self.index, self.room, self.law, self.flow_over_drop


def _fixed(tree: VesselTree, law: Law) -> NDArray[np.void]:
    """Segments of another tree, each by itself: it is in the way, and nothing else."""
    segments = segments_of(tree, law)
    for name in ("parent", "left", "right"):
        segments[name] = -1
    return segments


def _cooling(rounds: int, heat: float) -> FloatArray:
    """Heat of each round: falling as the square of what is left, none in the last ones."""
    warm = max(0, rounds - COLD)
    fall = heat * (1.0 - np.arange(warm) / max(1, warm)) ** 2
    return np.concatenate([fall, np.zeros(rounds - warm)])
