"""Grow the branches of one region of a large tree, clear of all vessels around it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.growth.growth_state import ALL_AROUND
from design.vasculature.growth.index import empty_index
from design.vasculature.growth.make_index import CELL, clearances_of, index_segments
from design.vasculature.growth.points import Sampler
from design.vasculature.growth.regions.cells import RegionSampler
from design.vasculature.growth.regions.job import RegionJob, box_of
from design.vasculature.growth.state import SEGMENT, Segments, refresh
from design.vasculature.growth.step import (
    GROWTH_POWER,
    PROGRESS,
    REBUILD,
    Scale,
    derive_radii,
)
from design.vasculature.growth.surroundings import Surroundings
from design.vasculature.growth.tree_growth import TRIES, TreeGrowth
from design.vasculature.options import GrowthOptions, Law
from design.vasculature.penalty import sample_penalty
from kernels import jit

LOAD_POWER = 1.0 + 4.0 * GROWTH_POWER
"""A branch's load grows with this power of its terminals: the root's radius with `GROWTH_POWER`."""

_NEAR = 6
"""Nearest segments considered for a new terminal: with `step.CANDIDATES` it takes a fifth longer
and the volume is no less (100,000 terminals: 1258 mm³, with these 1257)."""

_SYNC = 8
"""Branches elsewhere are made to grow alike each time the region has grown by one in so many."""


@dataclass
class RegionGrowth(TreeGrowth):
    """Growth of one region; all branches elsewhere are single segments that grow alike.

    Attributes
    ----------
    job : RegionJob
    sync_at : int
        Terminals at which branches elsewhere are made to grow next.
    """

    job: RegionJob = field(kw_only=True)
    sync_at: int = 0

    @classmethod
    def of(
        cls, tissue: Tissue, options: GrowthOptions, scale: Scale, job: RegionJob, seed: int
    ) -> RegionGrowth:
        """The growth that a job asks for; ``scale`` is that of the whole tree."""
        new = 2 * (job.goal - job.terminals)
        segments = np.zeros(len(job.segments) + new + len(job.around), SEGMENT)
        segments[: len(job.segments)] = job.segments
        segments[len(segments) - len(job.around) :] = job.around
        progress = np.zeros(1, PROGRESS)
        progress["count"], progress["terminals"] = len(job.segments), job.terminals
        progress["apart"], progress["thick"], progress["held"] = 0.9, 1.0, len(job.held)
        progress["candidates"] = ALL_AROUND if options.flow_ratio else _NEAR
        share = job.goal / scale.goal
        plain = Sampler.by(tissue, options, None)
        sampler = RegionSampler(tissue, plain.dense, plain.flows, None, job.corners, job.edge_mm)
        return cls(
            tissue,
            options,
            Surroundings(),
            clearances_of(tissue, options),
            scale._replace(goal=job.goal, volume=share * scale.volume, share=share),
            segments,
            progress,
            np.random.default_rng([seed, job.number]),
            empty_index(tissue.bounds, 1.0, 1, 1),
            sampler,
            sample_penalty(tissue, options.penalty),
            None,
            None,
            job=job,
        )

    def own(self) -> Segments:
        """The region's segments, numbered on from those that hold it."""
        return self.segments[len(self.job.held) : self.count].copy()

    @property
    def _per_wanted(self) -> float:
        cells = len(self.job.corners) * self.job.edge_mm**3
        return cells / (self.scale.volume * self.sampler.kept)

    def _tries(self) -> int:
        # They come in order, so that more would make another tree: 2 % more volume, measured.
        return int(TRIES * self._per_wanted * self.terminals) + 1

    def _pause_at(self) -> int:
        return min(super()._pause_at(), self.sync_at)

    def _pause(self, status: int) -> None:
        self._grow_leaves()
        self.sync_at = self.terminals + max(1, self.terminals // _SYNC)
        if status == REBUILD and self.terminals < super()._pause_at():
            derive_radii(self.segments, self.progress, self.options.law, self.scale)
        else:
            self._relist()

    def _measure(self) -> None:
        # Later on what is new has measured itself and its neighbours, and shares change little.
        if self.terminals == self.job.terminals:
            super()._measure()

    def _grow_leaves(self) -> None:
        """Make the branches elsewhere as large as they are by now."""
        job = self.job
        first = job.segments[job.leaves]
        whole = np.log(job.goal / job.terminals)
        done = np.log(self.terminals / job.terminals) / whole if whole > 0 else 1.0
        growth = (job.wanted / first["terminals"]) ** done
        set_leaves(
            self.segments,
            len(job.held),
            job.leaves,
            np.round(first["terminals"] * growth),
            first["flow"] * growth,
            first["load"] * growth**LOAD_POWER,
            first["spend"] * growth ** (0.25 * self.options.law.lam * LOAD_POWER),
            self.options.law,
        )

    def _reindex(self, own: int | None = None) -> None:
        """List everything anew, in a box around the region."""
        self.indexed = self.terminals
        job, goal = self.job, min(self.goal, 2 * self.terminals)
        cell = CELL * float(np.cbrt(self.scale.volume / max(8, goal)))
        segments = self.segments[len(job.held) : self.count]
        box = box_of(segments, job.corners, job.edge_mm, self.room.clearance)
        self.index = index_segments(
            np.stack(box), cell, self.segments, self.count, len(job.around), self.room
        )


def grow_region(
    tissue: Tissue, options: GrowthOptions, scale: Scale, job: RegionJob, seed: int
) -> Segments:
    """Grow a region as far as there is room; its segments, numbered on from those that hold it."""
    growth = RegionGrowth.of(tissue, options, scale, job, seed)
    # Out of room: what is missing grows elsewhere, or that says so.
    with suppress(GrowthError):
        growth.grow_to(job.goal)
    return growth.own()


@jit
def set_leaves(
    segments: Any,
    held: int,
    leaves: Any,
    terminals: Any,
    flow: Any,
    load: Any,
    spend: Any,
    law: Law,
) -> None:
    """Set what branches elsewhere carry, and recompute the ``held`` segments above them."""
    for n in range(len(leaves)):
        s = segments[leaves[n]]
        s.terminals, s.flow, s.load, s.spend = terminals[n], flow[n], load[n], spend[n]
    for i in range(held - 1, -1, -1):
        if segments[i].left >= 0:
            refresh(segments, i, law)
