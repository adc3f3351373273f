"""Divide an early tree's branches, and the tissue, into regions for further growth in parallel."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.tissue import Tissue
from design.vasculature.growth.kernels.cost import Segments
from design.vasculature.growth.kernels.points import share_terminals
from design.vasculature.growth.supply import demand_points
from kernels.arrays import FloatArray, IntArray

SHARED = -1
"""Region of segments that feed branches of several regions."""


class RegionSettings(NamedTuple):
    """Sizes by which large trees are divided; chosen by time at 0.1 to 10 million terminals."""

    from_terminals: int = 100_000
    """A tree of as many terminals is grown by regions."""
    early_terminals: int = 10_000
    early_divisor: int = 50
    """Terminals of the early tree that is split: so many at least, or one in so many of all."""
    region_terminals: int = 8_000
    """Of a region when it is grown, at most: its segments then stay in a core's cache."""
    region_branches: int = 8
    """Branches of the early tree that make up a region."""
    cell_factor: float = 0.6
    """Edge of a cell over the mean spacing of the early tree's terminals."""
    region_points: int = 1000
    min_points: int = 100_000
    max_points: int = 2_000_000
    """Points that measure demand: per region, and at least and at most of all."""
    nearest: int = 6
    """Segments considered for a new terminal. With `kernel.SEARCH.nearest` growth takes a fifth
    longer for the same volume (100,000 terminals: 1258 mm³, with these 1257)."""
    sync_divisor: int = 8
    """Branches elsewhere are enlarged each time a region has grown by one in so many."""
    cells_per_batch: int = 1 << 18
    """Centres of cells that are made at a time."""


REGIONS = RegionSettings()


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
            border = (one != two) & (one >= 0) & (two >= 0)
            pairs = np.unique(one[border].astype(np.int64) * regions + two[border])
            for a, b in zip((pairs // regions).tolist(), (pairs % regions).tolist(), strict=True):
                neighbours[a].add(b)
                neighbours[b].add(a)
        return neighbours


@dataclass(frozen=True)
class Split:
    """An early tree and its regions.

    Attributes
    ----------
    early : (n,) Segments
        The tree, depth first.
    region : (n,) int64
        Of each segment, or `SHARED`.
    place : (n,) int64
        Number of each segment among those of its region, or among the shared ones.
    roots : (b,) int64
        Segments that the branches begin with.
    goal : (k,) int64
        Terminals that each region is to have.
    wanted : (n,) float64
        Terminals that each segment is to feed.
    cells : RegionCells
    corners : list of (m, 3) float64, mm
        Of each region's cells.
    order : (k,) int64
        Regions in the order in which they are begun.
    after : list of set of int
        For each region, the neighbours that must be grown before it.
    """

    early: Segments
    region: IntArray
    place: IntArray
    roots: IntArray
    goal: IntArray
    wanted: FloatArray
    cells: RegionCells
    corners: list[FloatArray]
    order: IntArray
    after: list[set[int]]

    @property
    def regions(self) -> int:
        """How many there are."""
        return len(self.goal)


def split_tree(early: Segments, tissue: Tissue, terminals: int, dense: bool, seed: int) -> Split:
    """Split an early tree into regions of at most `REGIONS.region_terminals` terminals.

    Parameters
    ----------
    early : (n,) Segments
        Depth first, two children at each joint.
    tissue : Tissue
    terminals : int
        Of the finished tree.
    dense : bool
        Whether terminals are denser where the demand is higher.
    seed : int
        Of the points by which demand is measured.
    """
    most = max(2.0, REGIONS.region_terminals * len(early) / (2.0 * terminals))
    branch, roots = _branches(early, max(1, int(most / REGIONS.region_branches)))
    tips = np.flatnonzero((early["left"] < 0) & (branch >= 0))
    at = np.column_stack([early["dx"], early["dy"], early["dz"]])[tips]
    weight = early["terminals"][roots].astype(np.float64)
    centre = [np.bincount(branch[tips], weights=at[:, x]) / weight for x in range(3)]
    of_branch = _halved(np.column_stack(centre), weight, most)
    region = np.where(branch >= 0, of_branch[branch], SHARED)
    cells = divide(tissue, REGIONS.cell_factor * _spacing(tissue, early), at, region[tips])
    count = int(of_branch.max()) + 1
    has = np.bincount(region[tips], minlength=count)
    goal = share_terminals(_demand(tissue, cells, count, dense, seed), has, terminals)
    neighbours = cells.neighbours(count)
    colour = _colours(neighbours)
    after = [
        {other for other in touching if colour[other] < colour[own]}
        for own, touching in enumerate(neighbours)
    ]
    return Split(
        early,
        region,
        _places(region, count),
        roots,
        goal,
        _wanted(early, region, goal / has),
        cells,
        cells.corners(count),
        np.argsort(colour, kind="stable"),
        after,
    )


def _branches(early: Segments, most: int) -> tuple[IntArray, IntArray]:
    """Number of each segment's branch (-1 for none), and the segment that each begins with.

    A branch feeds at most ``most`` terminals, and what is above it more.
    """
    small = early["terminals"] <= most
    small[0] = False
    begins = small & ~small[early["parent"]]
    # Depth first: a branch's segments follow its first one.
    return np.where(small, np.cumsum(begins) - 1, -1), np.flatnonzero(begins)


def _halved(at: FloatArray, weight: FloatArray, most: float) -> IntArray:
    """Group points (n, 3) into boxes by halving until each weighs at most ``most``; their group."""
    group = np.empty(len(at), np.int64)
    count = 0
    stack = [np.arange(len(at))]
    while stack:
        own = stack.pop()
        total = float(weight[own].sum())
        if total <= most or len(own) == 1:
            group[own] = count
            count += 1
            continue
        axis = int(np.argmax(np.ptp(at[own], axis=0)))
        own = own[np.argsort(at[own, axis], kind="stable")]
        half = int(np.searchsorted(np.cumsum(weight[own]), 0.5 * total))
        half = min(max(half, 1), len(own) - 1)
        stack += [own[half:], own[:half]]
    return group


def _spacing(tissue: Tissue, early: Segments) -> float:
    return float(np.cbrt(tissue.volume_mm3 / int(early["terminals"][0])))


def _demand(tissue: Tissue, cells: RegionCells, count: int, dense: bool, seed: int) -> FloatArray:
    """Each region's share of what the terminals are placed by."""
    points, weight = demand_points(
        tissue,
        int(np.clip(REGIONS.region_points * count, REGIONS.min_points, REGIONS.max_points)),
        seed,
    )
    owner = cells.owners(points)
    seen = owner >= 0
    weight = weight[seen] if dense else np.ones(np.count_nonzero(seen))
    return np.bincount(owner[seen], weights=weight, minlength=count) / weight.sum()


def _colours(touching: list[set[int]]) -> IntArray:
    """Colour regions so that no two that touch have the same; each takes the first that is free."""
    colour = np.full(len(touching), -1, np.int64)
    for own, others in enumerate(touching):
        taken = {int(colour[other]) for other in others}
        colour[own] = next(c for c in range(len(others) + 1) if c not in taken)
    return colour


def _places(region: IntArray, count: int) -> IntArray:
    """Number of each segment among those of its region."""
    place = np.empty(len(region), np.int64)
    order = np.argsort(region, kind="stable")
    sizes = np.bincount(region + 1, minlength=count + 1)
    place[order] = np.arange(len(region)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return place


def _wanted(early: Segments, region: IntArray, growth: FloatArray) -> FloatArray:
    """Terminals that each segment is to feed, if all of a region's multiply alike."""
    tip = (early["left"] < 0) & (region >= 0)
    sums = np.concatenate([[0.0], np.cumsum(np.where(tip, growth[region], 0.0))])
    first = np.arange(len(early))
    # Depth first: a segment's branch is the next 2 n - 1.
    return sums[first + 2 * early["terminals"] - 1] - sums[first]


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
    for begin in range(0, len(owner), REGIONS.cells_per_batch):
        some = np.arange(begin, min(begin + REGIONS.cells_per_batch, len(owner)))
        centre = low + edge_mm * (np.column_stack(np.unravel_index(some, shape)) + 0.5)
        touches = tissue.grid.distance(centre) < 0.5 * np.sqrt(3.0) * edge_mm
        owner[some[touches]] = region[nearest.query(centre[touches])[1]]
    return RegionCells(low, edge_mm, owner.reshape(shape))
