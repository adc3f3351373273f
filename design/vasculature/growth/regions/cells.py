"""Cells of a cubic grid that divide a tissue among regions; points drawn from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.tissue import Tissue
from design.vasculature.growth.points import Sampler
from design.vasculature.growth.target_points import Samples, inside
from kernels.arrays import FloatArray

_ROWS = 1 << 18
"""Centres of cells made at a time."""

_ONE_AT_A_TIME = Lock()
"""A demand may be read by a kernel of several threads, which can't be entered twice."""


@dataclass(frozen=True)
class RegionCells:
    """Which region each cell of a grid belongs to.

    Attributes
    ----------
    low : (3,) float64, mm
        Lowest corner of the grid.
    edge_mm : float
    owner : (a, b, c) int32
        Region of a cell, -1 where it doesn't touch the tissue.
    """

    low: FloatArray
    edge_mm: float
    owner: NDArray[np.int32]

    def owners(self, points: FloatArray) -> NDArray[np.int32]:
        """Region of each of ``points`` (n, 3), mm; -1 for none."""
        at = ((points - self.low) / self.edge_mm).astype(np.int64)
        at = np.clip(at, 0, np.array(self.owner.shape) - 1)
        owners: NDArray[np.int32] = self.owner[at[:, 0], at[:, 1], at[:, 2]]
        return owners

    def corners(self, regions: int) -> list[FloatArray]:
        """Lowest corners of each region's cells, (m, 3) each, mm."""
        flat = self.owner.ravel()
        order = np.argsort(flat, kind="stable")
        first = np.searchsorted(flat[order], np.arange(regions + 1))
        corners = []
        for begin, end in pairwise(first):
            cell = np.unravel_index(order[begin:end], self.owner.shape)
            corners.append(self.low + self.edge_mm * np.column_stack(cell))
        return corners

    def neighbours(self, regions: int) -> list[set[int]]:
        """For each region, those that its cells touch."""
        neighbours: list[set[int]] = [set() for _ in range(regions)]
        for step in product((-1, 0, 1), repeat=3):
            if step <= (0, 0, 0):
                continue
            one, two = self.owner[_shifted(step, 0)], self.owner[_shifted(step, 1)]
            apart = (one != two) & (one >= 0) & (two >= 0)
            pairs = np.unique(one[apart].astype(np.int64) * regions + two[apart])
            for a, b in zip((pairs // regions).tolist(), (pairs % regions).tolist(), strict=True):
                neighbours[a].add(b)
                neighbours[b].add(a)
        return neighbours


def _shifted(step: tuple[int, ...], side: int) -> tuple[slice, ...]:
    """Slices of a grid that pair each cell with the one a step further."""
    low, high = slice(0, -1), slice(1, None)
    pick = {0: (slice(None), slice(None)), 1: (low, high), -1: (high, low)}
    return tuple(pick[one][side] for one in step)


def divide(tissue: Tissue, edge_mm: float, tips: FloatArray, region: NDArray[Any]) -> RegionCells:
    """Give each cell that touches the tissue to the region of the tip nearest to its centre.

    Parameters
    ----------
    tips : (n, 3) float64, mm
    region : (n,) int
        Region of each tip.
    """
    low, high = tissue.bounds
    shape = tuple(np.maximum(1, np.ceil((high - low) / edge_mm)).astype(int).tolist())
    owner = np.full(int(np.prod(shape)), -1, np.int32)
    nearest = KDTree(tips)
    for begin in range(0, len(owner), _ROWS):
        some = np.arange(begin, min(begin + _ROWS, len(owner)))
        centre = low + edge_mm * (np.column_stack(np.unravel_index(some, shape)) + 0.5)
        touches = tissue.grid.distance(centre) < 0.5 * np.sqrt(3.0) * edge_mm
        owner[some[touches]] = region[nearest.query(centre[touches])[1]]
    return RegionCells(low, edge_mm, owner.reshape(shape))


@dataclass(frozen=True)
class RegionSampler(Sampler):
    """Points in a region's cells.

    Attributes
    ----------
    corners : (m, 3) float64, mm
        Lowest corner of each cell.
    edge_mm : float
    """

    corners: FloatArray
    edge_mm: float

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest corner of all cells, mm."""
        return self.corners.min(axis=0), self.corners.max(axis=0) + self.edge_mm

    def draw(self, random: np.random.Generator, tries: int, in_order: bool) -> Samples:
        """Those of so many points in the cells that lie in the tissue and are wanted."""
        cell = random.integers(len(self.corners), size=tries)
        points = self.corners[cell] + self.edge_mm * random.uniform(size=(tries, 3))
        points = inside(self.tissue.grid.arrays, points, *self.box, True)
        if not (self.dense or self.flows):
            return self.weighed(random, points)
        with _ONE_AT_A_TIME:
            return self.weighed(random, points)
