"""Arrays of one tree during growth: segments, spatial index, points for new terminals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.growth.cost import SEGMENT, depth_first
from design.vasculature.growth.final_tree import final_arrays
from design.vasculature.growth.index import (
    CELL,
    CellIndex,
    Clearances,
    clear_of,
    clearances_of,
    empty_index,
    index_segments,
)
from design.vasculature.growth.kernel import CANDIDATES, PROGRESS, Scale
from design.vasculature.growth.points import GivenPoints, Sampler, Samples
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions
from design.vasculature.penalty import PenaltyArrays, sample_penalty
from design.vasculature.tree import VesselTree

_EAGER, _PATIENT = 6, 400
"""Patience (see `Scale`) of thin trees, which get everywhere at once, and of those with a smallest
radius: with that of the former, 95 % of a folded slab lay within 7.9 mm of a lumen, not 1.9."""


_SMALL = 10_000
"""Terminals below which a tree is in the cache, however it is ordered."""


_EARLY = 0.45
"""Part of the terminals up to which a given trunk's branches are kept narrow."""


ALL_AROUND = 40
"""Nearest segments considered for given points missed at first, or with a flow ratio."""


@dataclass
class GrowthState:
    """The arrays of one growth; same arguments, same growth."""

    tissue: Tissue
    options: GrowthOptions
    others: Surroundings
    room: Clearances
    scale: Scale
    segments: NDArray[np.void]
    progress: NDArray[np.void]
    random: np.random.Generator
    index: CellIndex
    sampler: Sampler
    penalty: PenaltyArrays
    given: GivenPoints | None
    trunk: Trunk | None
    indexed: int = 0
    stage: int = -1
    unreached: int = -1
    narrow_until: int = 0

    @classmethod
    def open(
        cls,
        tissue: Tissue,
        options: GrowthOptions,
        others: Surroundings,
        spread: float,
        attempt: int,
        trunk: Trunk | None = None,
    ) -> Self:
        """A growth with nothing in it yet; same arguments, same growth."""
        if options.root_candidates:
            raise GrowthError(
                "a root is searched for a tree alone (grow_tree); give each of several trees its "
                "root point"
            )
        given = GivenPoints.of(tissue, options)
        goal = options.terminals + (trunk.tips if given is not None and trunk is not None else 0)
        if trunk is not None:
            trunk.check(goal, options, tissue)
        fixed = options.smallest_radius_mm or 0.0
        spread = spread if fixed else 0.0
        root = fixed * spread * goal ** (1.0 / options.murray_exponent)
        volume = others.share * tissue.volume_mm3
        drop = options.flow_ul_s(volume) / options.pressure_drop_pa
        patience = _PATIENT if fixed else _EAGER
        own = np.zeros(2 * goal + 1 + (len(trunk.parent) if trunk else 0), SEGMENT)
        # The stem and its first two; all others get theirs when they are made. Memory that isn't
        # written isn't taken.
        own["flow"][:3] = own["thick"][:3] = 1.0
        progress = np.zeros(1, PROGRESS)
        progress["apart"], progress["thick"] = 0.9, 1.0
        progress["candidates"] = ALL_AROUND if options.flow_ratio else CANDIDATES
        return cls(
            tissue,
            options,
            others,
            clearances_of(tissue, options),
            Scale(drop, root, spread, goal, volume, patience),
            np.concatenate([own, others.records()]) if others.count else own,
            progress,
            np.random.default_rng([options.seed, attempt]),
            empty_index(tissue.bounds, float(np.ptp(tissue.bounds)), 1, 1),
            Sampler.by(tissue, options, others.owns),
            sample_penalty(tissue, options.penalty),
            given,
            trunk,
            narrow_until=round(_EARLY * goal) if trunk and trunk.widest_branch < np.inf else 0,
        )

    @property
    def count(self) -> int:
        """Segments grown."""
        return int(self.progress["count"][0])

    @property
    def goal(self) -> int:
        """Terminals of the finished tree; with given points, a trunk's own besides."""
        return self.scale.goal

    @property
    def terminals(self) -> int:
        """Terminals grown."""
        return int(self.progress["terminals"][0])

    def meet(self, others: Surroundings) -> None:
        """Take the vessels of others as they are now."""
        own = self.segments[: len(self.segments) - self.others.count]
        self.others, self.segments = others, np.concatenate([own, others.records()])

    def _samples(self, tries: int) -> Samples:
        """Points to grow to: so many tries at new ones, or the given ones that are left."""
        if self.given is not None:
            return self.given.samples(self.random.permutation(self._missing(self.given)))
        return self.sampler.draw(self.random, tries, self.terminals > _SMALL)

    def _missing(self, given: GivenPoints) -> NDArray[np.int64]:
        """Given points that aren't reached."""
        s = self.segments[: self.count]
        tips = s[(s["left"] < 0) & (s["given"] == 0)]
        return given.missing(np.column_stack([tips["dx"], tips["dy"], tips["dz"]]))

    @property
    def _per_wanted(self) -> float:
        """Points in the bounds for each that is wanted."""
        box = float(np.prod(np.ptp(self.tissue.bounds, axis=0)))
        return box / (self.scale.volume * self.sampler.kept)

    def _clear(self, begin: Any, points: Any, radius: float) -> Any:
        """Whether capsules from ``begin`` to each of ``points`` clear the vessels of others."""
        self._reindex(own=0)
        return clear_of(self.segments, self.index, self.room, begin, points, radius)

    def _reindex(self, own: int | None = None) -> None:
        """List everything anew, in cells that suit the tree until it has doubled.

        Of the tree's own segments ``own`` are listed, or all.
        """
        self.indexed = max(4, self.terminals)
        self._in_order()
        goal = min(self.goal, 2 * self.terminals)
        cell = CELL * float(np.cbrt(self.scale.volume / max(8, goal)))
        count = self.count if own is None else own
        self.index = index_segments(
            self.tissue.bounds, cell, self.segments, count, self.others.count, self.room
        )

    def _in_order(self) -> None:
        """Number the segments by branch where the cache asks for it."""
        if self.terminals > _SMALL:
            self.segments = depth_first(self.segments, self.count)

    def _enter_stage(self) -> GrowthOptions:
        """Take the parameters of the stage that growth is in, and return them."""
        stages, settings, now = self.options.stages, self.options, -1
        if stages:
            ends = [stage.terminals for stage in stages[:-1]]
            now = int(np.searchsorted(ends, self.terminals, side="right"))
            settings = self.options.at_stage(stages[now])
        self.room = clearances_of(self.tissue, settings)
        if now != self.stage:
            self.stage = now
            self.sampler = Sampler.by(self.tissue, settings, self.others.owns)
            self.penalty = sample_penalty(self.tissue, settings.penalty)
        return settings

    def tree(self) -> VesselTree:
        """The finished tree, its ratios computed afresh; the growth's own arrays are let go."""
        self.index = empty_index(self.tissue.bounds, 1e9, 1, 1)
        s = self.segments[: self.count]
        arrays = final_arrays(s, self.tissue, self.options, self.scale, self.trunk)
        del s
        self.segments = self.segments[:0].copy()
        return arrays.tree(self.options)


def just_below(value: float) -> float:
    """A hair below a value: what meets it to rounding passes."""
    return value * (1.0 - 1e-9)
