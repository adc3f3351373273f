"""Array of a large tree's segments with a slot for each region, filled as regions are grown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.regions.split import SHARED, Split
from design.vasculature.growth.state import SEGMENT, Segments
from kernels.arrays import IntArray


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
