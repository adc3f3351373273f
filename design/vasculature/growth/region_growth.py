"""Grow the branches of one region of a large tree, clear of all vessels around it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.growth.cost import SEGMENT, Segments, refresh
from design.vasculature.growth.growth_state import ALL_AROUND
from design.vasculature.growth.index import CELL, REACH, clearances_of, empty_index, index_segments
from design.vasculature.growth.kernel import GROWTH_POWER, PROGRESS, REBUILD, Scale, derive_radii
from design.vasculature.growth.points import Sampler
from design.vasculature.growth.region_split import SHARED, RegionSampler, Split
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.tree import TRIES, TreeGrowth
from design.vasculature.options import GrowthOptions, Law
from design.vasculature.penalty import sample_penalty
from kernels import jit
from kernels.arrays import FloatArray, IntArray

LOAD_POWER = 1.0 + 4.0 * GROWTH_POWER
"""A branch's load grows with this power of its terminals: the root's radius with `GROWTH_POWER`."""
_NEAR = 6
"""Nearest segments considered for a new terminal: with `step.CANDIDATES` it takes a fifth longer
and the volume is no less (100,000 terminals: 1258 mm³, with these 1257)."""
_SYNC = 8
"""Branches elsewhere are made to grow alike each time the region has grown by one in so many."""


# Inputs for growing one region: its branches, the segments upstream, vessels around it.


@dataclass(frozen=True)
class RegionJob:
    """All that one region's growth depends on, beside tissue and options.

    Attributes
    ----------
    number : int
        Of the region.
    segments : (h + n,) Segments
        The tree as the region sees it: the ``h`` segments that hold it (its branches' ancestors and
        what else leaves these, parents first), then its own.
    held : (h,) int64
        Numbers in the store of those that hold it.
    leaves : (l,) int64
        Of the first ``h``, those that stand for branches elsewhere.
    wanted : (l,) float64
        Terminals that each of them is to feed.
    around : (m,) Segments
        Vessels of others near the region.
    terminals, goal : int
        Of the region, now and when it is grown.
    corners : (c, 3) float64, mm
        Of its cells.
    edge_mm : float
        Of a cell.
    """

    number: int
    segments: Segments
    held: IntArray
    leaves: IntArray
    wanted: FloatArray
    around: Segments
    terminals: int
    goal: int
    corners: FloatArray
    edge_mm: float


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


def region_job(split: Split, store: Store, number: int, clearance_mm: float) -> RegionJob:
    """The job of a region once those that it comes after are in the store."""
    early = split.early
    own = np.flatnonzero(split.region == number)
    path = _ancestors(early, split.roots[split.region[split.roots] == number])
    leaves = _leaving(early, split.region, path, number)
    held = np.sort(np.concatenate([path, leaves]))
    segments = _as_seen(split, store, held, leaves, own)
    corners = split.corners[number]
    low, high = box_of(segments[len(held) :], corners, split.cells.edge_mm, clearance_mm)
    return RegionJob(
        number,
        segments,
        store.number(split, held),
        np.searchsorted(held, leaves),
        split.wanted[leaves],
        _around(split, store, number, held, (low, high, clearance_mm)),
        int(np.count_nonzero(early["left"][own] < 0)),
        int(split.goal[number]),
        corners,
        split.cells.edge_mm,
    )


def _ancestors(early: Segments, roots: IntArray) -> IntArray:
    """All segments above the given ones, sorted."""
    is_above = np.zeros(len(early), dtype=bool)
    above = np.unique(early["parent"][roots])
    while len(above):
        is_above[above] = True
        above = np.unique(early["parent"][above])
        above = above[above >= 0]
        above = above[~is_above[above]]
    return np.flatnonzero(is_above)


def _leaving(early: Segments, region: IntArray, path: IntArray, number: int) -> IntArray:
    """Children of the ancestors that are neither ancestors nor the region's own, sorted."""
    children = np.unique(np.concatenate([early["left"][path], early["right"][path]]))
    return np.setdiff1d(children[region[children] != number], path).astype(np.int64)


def _as_seen(
    split: Split, store: Store, held: IntArray, leaves: IntArray, own: IntArray
) -> Segments:
    """The region's part of the tree, renumbered; other branches as their first segments are now."""
    early = split.early
    both = np.concatenate([held, own])
    local = np.full(len(early) + 1, -1, np.int32)
    local[both] = np.arange(len(both))
    segments = early[both]
    for name in ("parent", "left", "right"):
        segments[name] = local[segments[name]]
    at = np.searchsorted(held, leaves)
    segments["left"][at] = segments["right"][at] = -1
    for here, there in zip(at.tolist(), leaves.tolist(), strict=True):
        region = int(split.region[there])
        if region != SHARED and store.used[region]:
            now = store.slot(region)[split.place[there]]
            for name in ("px", "py", "pz", "dx", "dy", "dz", "length", "radius"):
                segments[name][here] = now[name]
    return segments


def _around(
    split: Split,
    store: Store,
    number: int,
    held: IntArray,
    box: tuple[FloatArray, FloatArray, float],
) -> Segments:
    """Vessels of others within a box: of finished neighbours as grown, of the rest as they were.

    What holds the region isn't among them.
    """
    done = np.zeros(split.regions + 1, dtype=bool)
    done[list(split.after[number])] = True
    aside = done[split.region]
    aside[split.region == number] = True
    aside[held] = True
    near = near_box(split.early, *box)
    near_parts = [split.early[near[~aside[near]]]]
    for other in sorted(split.after[number]):
        slot = store.slot(other)
        kept = np.zeros(len(slot), dtype=bool)
        kept[near_box(slot, *box)] = True
        kept[split.place[held[split.region[held] == other]]] = False
        near_parts.append(slot[kept])
    return np.concatenate(near_parts)


def box_of(
    own: Segments, corners: FloatArray, edge_mm: float, clearance_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Corners of the box around a region's cells and segments and all that may touch these, mm."""
    begin, end = (np.column_stack([own[f"{side}{x}"] for x in "xyz"]) for side in "pd")
    margin = REACH * float(own["radius"].max()) + clearance_mm
    low = np.minimum(np.minimum(begin, end).min(axis=0), corners.min(axis=0))
    high = np.maximum(np.maximum(begin, end).max(axis=0), corners.max(axis=0) + edge_mm)
    return low - margin, high + margin


@jit
def near_box(segments: Any, low: Any, high: Any, clearance: float) -> Any:
    """Numbers of the segments that may touch what is within a box (two corners), ascending."""
    numbers = np.empty(len(segments), np.int64)
    size = 0
    for i in range(len(segments)):
        s = segments[i]
        reach = REACH * s.radius + clearance
        if min(s.px, s.dx) - reach > high[0] or max(s.px, s.dx) + reach < low[0]:
            continue
        if min(s.py, s.dy) - reach > high[1] or max(s.py, s.dy) + reach < low[1]:
            continue
        if min(s.pz, s.dz) - reach > high[2] or max(s.pz, s.dz) + reach < low[2]:
            continue
        numbers[size] = i
        size += 1
    return numbers[:size]


# Array of a large tree's segments with a slot for each region, filled as regions are grown.


@dataclass(frozen=True)
class Store:
    """Segments of the whole tree: the shared ones, then each region's own.

    Attributes
    ----------
    segments : (2 terminals + 1,) Segments
        Memory is taken only as slots are filled.
    first : (k + 1,) int64
        First segment of each region's slot; the last is the end of all slots.
    used : (k,) int64
        Segments of each region; 0 until it is grown.
    """

    segments: Segments
    first: IntArray
    used: IntArray

    @classmethod
    def of(cls, split: Split) -> Store:
        """A store of the shared segments alone."""
        tips = (split.early["left"] < 0).astype(np.float64)
        has = np.bincount(split.region + 1, weights=tips, minlength=split.regions + 1)[1:]
        own = np.bincount(split.region + 1, minlength=split.regions + 1)
        sizes = own[1:] + 2 * (split.goal - has.astype(np.int64))
        first = own[0] + np.concatenate([[0], np.cumsum(sizes)])
        store = cls(np.zeros(int(first[-1]), SEGMENT), first, np.zeros(split.regions, np.int64))
        store._fill_shared(split)
        return store

    def _fill_shared(self, split: Split) -> None:
        shared = np.flatnonzero(split.region == SHARED)
        number = self.number(split, np.arange(len(split.early)))
        self.segments[: len(shared)] = split.early[shared]
        top = self.segments[: len(shared)]
        for name in ("parent", "left", "right"):
            top[name] = np.where(top[name] < 0, -1, number[top[name]])

    def number(self, split: Split, early: IntArray) -> IntArray:
        """Number in the store of segments of the early tree."""
        region = split.region[early]
        return split.place[early] + np.where(region == SHARED, 0, self.first[region])

    def slot(self, region: int) -> Segments:
        """A region's segments as far as they are grown."""
        begin = int(self.first[region])
        return self.segments[begin : begin + int(self.used[region])]

    def fill(self, region: int, own: Segments, held: IntArray) -> None:
        """Take a region's segments, numbered on from those that it was held by.

        Parameters
        ----------
        held : (h,) int64
            Numbers in the store of the segments that the region's were numbered on from.
        """
        self.used[region] = len(own)
        slot = self.slot(region)
        slot[:] = own
        begin = int(self.first[region]) - len(held)
        for name in ("parent", "left", "right"):
            local = own[name].astype(np.int64)
            above = (local >= 0) & (local < len(held))
            there = np.where(local < 0, -1, local + begin)
            there[above] = held[local[above]]
            slot[name] = there

    def gaps(self) -> NDArray[np.uint8]:
        """Whether each segment is one of a slot that a region fell short of."""
        empty = np.zeros(len(self.segments), np.uint8)
        for begin, end, used in zip(self.first[:-1], self.first[1:], self.used, strict=True):
            empty[begin + used : end] = 1
        return empty
