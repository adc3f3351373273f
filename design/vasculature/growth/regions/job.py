"""Inputs for growing one region: its branches, the segments upstream, vessels around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from design.vasculature.growth.index import REACH
from design.vasculature.growth.regions.split import SHARED, Split
from design.vasculature.growth.regions.store import Store
from design.vasculature.growth.state import Segments
from kernels import jit
from kernels.arrays import FloatArray, IntArray


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
