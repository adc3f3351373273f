"""Grow a tree of 100,000 or more terminals region by region, in parallel.

An early tree grows serially; `growth.region_split` divides its branches and the tissue. Here each
region is cut out with what it sees of the rest, grown by whoever is free, and put back.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.kernels.allowed_radius import (
    allowed_radius,
    measure_changed,
    too_wide,
)
from design.vasculature.growth.kernels.cost import SEGMENT, Segments, drop_marked, refresh
from design.vasculature.growth.kernels.index import REACH, CellIndex, Clearances
from design.vasculature.growth.kernels.new_ends import limit_joints
from design.vasculature.growth.kernels.search_settings import RADII
from design.vasculature.growth.region_split import REGIONS, SHARED, Split
from design.vasculature.growth.threads import PARALLEL, ClusterPool, run_in_order, thread_count
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions, Law
from kernels import jit, scalar_jit
from kernels.arrays import FloatArray, IntArray

RESISTANCE_POWER: Final = 1.0 + 4.0 * RADII.growth_power
"""Power of a branch's terminals with which its weighted resistance grows; see `PredictedRadii`."""


def terminals_before_split(options: GrowthOptions, trunk: Trunk | None) -> int:
    """Return with how many terminals a tree is split into regions; 0 for one that isn't.

    Not where radii set the viscosity, nor from a trunk, in stages or to given points: a region
    can't know these of the others.
    """
    suits = (
        options.terminals >= REGIONS.from_terminals
        and trunk is None
        and not options.stages
        and options.terminal_points_mm is None
        and options.law_haematocrit < 0.0
    )
    if not suits:
        return 0
    return max(REGIONS.early_terminals, options.terminals // REGIONS.early_divisor)


def grow_regions(
    split: Split,
    clearance_mm: float,
    executor: Executor | None,
    submit: Callable[[Executor, Region], Future[Any]],
) -> tuple[Segments, int]:
    """Grow all regions of a split tree, each once those that it comes after are grown.

    Parameters
    ----------
    executor : Executor, optional
        Threads of this process, one a core, by default.
    submit : function
        Hands a region's growth to the executor; its result are the region's segments, numbered on
        from those that hold it.

    Returns
    -------
    Segments, int
        The whole tree, its sums not yet derived anew; how many segments it has.
    """
    store = Store.of(split)
    regions: dict[int, Region] = {}

    def begin(number: int) -> Future[Any]:
        regions[number] = region_of(split, store, number, clearance_mm)
        return submit(pool, regions[number])

    def end(number: int, own: Any) -> None:
        store.fill(number, own, regions.pop(number).frozen)

    threads = thread_count()
    most = executor.parallel if isinstance(executor, ClusterPool) else threads + 1
    with nullcontext(executor) if executor else ThreadPoolExecutor(threads) as pool:
        run_in_order(split.order.tolist(), split.after, begin, end, most)
    return store.segments, drop_marked(store.segments, len(store.segments), store.gaps())


@dataclass(frozen=True)
class Region:
    """One region of a large tree: all that its growth depends on, beside tissue and options.

    Attributes
    ----------
    number : int
        Of the region.
    segments : (h + n,) Segments
        The tree as the region sees it: the ``h`` segments that hold it (its branches' ancestors and
        what else leaves these, parents first), then its own.
    frozen : (h,) int64
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
    frozen: IntArray
    leaves: IntArray
    wanted: FloatArray
    around: Segments
    terminals: int
    goal: int
    corners: FloatArray
    edge_mm: float

    def box(self, own: Segments, clearance_mm: float) -> tuple[FloatArray, FloatArray]:
        """Return the box around the region's cells and its ``own`` segments; see `box_of`."""
        return box_of(own, self.corners, self.edge_mm, clearance_mm)

    def grow_elsewhere(self, segments: Segments, terminals: int, law: Law) -> None:
        """Make the branches elsewhere as large as they are once the region has ``terminals``."""
        first = self.segments[self.leaves]
        whole = np.log(self.goal / self.terminals)
        done = np.log(terminals / self.terminals) / whole if whole > 0 else 1.0
        growth = (self.wanted / first["terminals"]) ** done
        set_leaves(
            segments,
            len(self.frozen),
            self.leaves,
            np.round(first["terminals"] * growth),
            first["flow"] * growth,
            first["weighted_resistance"] * growth**RESISTANCE_POWER,
            first["cost_sum"] * growth ** (0.25 * law.lam * RESISTANCE_POWER),
            law,
        )


@jit
def set_leaves(
    segments: Any,
    frozen: int,
    leaves: Any,
    terminals: Any,
    flow: Any,
    resistance: Any,
    cost_sum: Any,
    law: Law,
) -> None:
    """Set what branches elsewhere carry, and recompute the ``frozen`` segments above them."""
    for n in range(len(leaves)):
        s = segments[leaves[n]]
        s.terminals, s.flow, s.weighted_resistance, s.cost_sum = (
            terminals[n],
            flow[n],
            resistance[n],
            cost_sum[n],
        )
    for i in range(frozen - 1, -1, -1):
        if segments[i].left >= 0:
            refresh(segments, i, law)


def region_of(split: Split, store: Store, number: int, clearance_mm: float) -> Region:
    """Return a region as it is once those that it comes after are in the store."""
    early = split.early
    own = np.flatnonzero(split.region == number)
    path = _ancestors(early, split.roots[split.region[split.roots] == number])
    leaves = _leaving(early, split.region, path, number)
    frozen = np.sort(np.concatenate([path, leaves]))
    segments = _as_seen(split, store, frozen, leaves, own)
    corners = split.corners[number]
    low, high = box_of(segments[len(frozen) :], corners, split.cells.edge_mm, clearance_mm)
    return Region(
        number,
        segments,
        store.number(split, frozen),
        np.searchsorted(frozen, leaves),
        split.wanted[leaves],
        _around(split, store, number, frozen, (low, high, clearance_mm)),
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
    split: Split, store: Store, frozen: IntArray, leaves: IntArray, own: IntArray
) -> Segments:
    """The region's part of the tree, renumbered; other branches as their first segments are now."""
    early = split.early
    both = np.concatenate([frozen, own])
    local = np.full(len(early) + 1, -1, np.int32)
    local[both] = np.arange(len(both))
    segments = early[both]
    for name in ("parent", "left", "right"):
        segments[name] = local[segments[name]]
    at = np.searchsorted(frozen, leaves)
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
    frozen: IntArray,
    box: tuple[FloatArray, FloatArray, float],
) -> Segments:
    """Vessels of others within a box: of finished neighbours as grown, of the rest as they were.

    What holds the region isn't among them.
    """
    done = np.zeros(split.regions + 1, dtype=bool)
    done[list(split.after[number])] = True
    aside = done[split.region]
    aside[split.region == number] = True
    aside[frozen] = True
    near = near_box(split.early, *box)
    near_parts = [split.early[near[~aside[near]]]]
    for other in sorted(split.after[number]):
        slot = store.slot(other)
        kept = np.zeros(len(slot), dtype=bool)
        kept[near_box(slot, *box)] = True
        kept[split.place[frozen[split.region[frozen] == other]]] = False
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

    def fill(self, region: int, own: Segments, frozen: IntArray) -> None:
        """Take a region's segments, numbered on from its frozen ones.

        Parameters
        ----------
        frozen : (h,) int64
            Numbers in the store of the segments that the region's were numbered on from.
        """
        self.used[region] = len(own)
        slot = self.slot(region)
        slot[:] = own
        begin = int(self.first[region]) - len(frozen)
        for name in ("parent", "left", "right"):
            local = own[name].astype(np.int64)
            above = (local >= 0) & (local < len(frozen))
            there = np.where(local < 0, -1, local + begin)
            there[above] = frozen[local[above]]
            slot[name] = there

    def gaps(self) -> NDArray[np.uint8]:
        """Whether each segment is one of a slot that a region fell short of."""
        empty = np.zeros(len(self.segments), np.uint8)
        for begin, end, used in zip(self.first[:-1], self.first[1:], self.used, strict=True):
            empty[begin + used : end] = 1
        return empty


def measure_again(
    segments: Any, count: int, index: CellIndex, clearances: Clearances, smallest: float
) -> int:
    """Derive allowed radii as `measure_in_parallel`, but only where they may be less.

    Two segments that were measured beside each other had room to grow by one factor, and their
    allowed radii are at most by that factor larger. So they fit as long as each keeps below its
    own; a segment that doesn't is measured anew, as is one whose ends moved or whose radius changed
    much.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    mark_changed(segments, count)
    measure_changed(segments, count, index, clearances, smallest, False)
    limit_joints(segments, count, clearances)
    return int(too_wide(segments, count))


@scalar_jit
def mark_changed(segments: Any, count: int) -> None:
    """Allow any radius to what must be measured anew: that is what `measure_changed` looks for."""
    for i in range(count):
        s = segments[i]
        alike = (
            PARALLEL.min_radius_ratio * s.audited < s.radius < PARALLEL.max_radius_ratio * s.audited
        )
        if not alike or s.radius > s.allowed or s.allowed == np.inf:
            s.allowed, s.audited = np.inf, s.radius


def measure_in_parallel(
    segments: Any,
    count: int,
    index: CellIndex,
    clearances: Clearances,
    smallest: float,
    threads: int,
) -> int:
    """Derive allowed radii as `growth.checks.measure_allowed_radii` with joints does.

    Every segment is measured by itself, so that the result doesn't depend on the threads.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    # Without a reserve the search for neighbours goes on to the nearest.
    alone = clearances._replace(reserve=0.0)

    def measure(begin: int) -> None:
        own = index._replace(stamp=np.zeros_like(index.stamp), query=np.zeros_like(index.query))
        end = min(begin + PARALLEL.segments_per_task, count)
        measure_alone(segments, begin, end, own, alone, smallest)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(measure, range(0, count, PARALLEL.segments_per_task)))
    limit_joints(segments, count, clearances)
    return int(too_wide(segments, count))


@scalar_jit
def measure_alone(
    segments: Any, begin: int, end: int, index: CellIndex, clearances: Clearances, smallest: float
) -> None:
    """Derive the allowed radii of segments ``begin`` to ``end`` from tissue and neighbours."""
    for i in range(begin, end):
        s = segments[i]
        s.allowed, s.audited = np.inf, s.radius
        if s.given != 0:
            continue
        s.allowed = allowed_radius(segments, i, index, clearances, False)
        if s.left < 0 and s.radius < smallest:
            s.allowed = min(s.allowed, 0.0)
