"""Grow a tree of 100,000+ terminals: serially to 10,000 or 2 % of them, then region by region."""

from __future__ import annotations

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Final

from design.vasculature.growth.prune import drop_marked
from design.vasculature.growth.regions.audit import measure_again, measure_in_parallel
from design.vasculature.growth.regions.cluster import ClusterPool
from design.vasculature.growth.regions.job import region_job
from design.vasculature.growth.regions.parallel import run_in_order
from design.vasculature.growth.regions.region_growth import grow_region
from design.vasculature.growth.regions.split import Split, split_tree
from design.vasculature.growth.regions.store import Store
from design.vasculature.growth.state import refresh_all
from design.vasculature.growth.step import derive_radii
from design.vasculature.growth.target_points import depth_first
from design.vasculature.growth.tree_growth import TreeGrowth
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions

LARGE: Final = 100_000
"""Terminals from which a tree is grown by regions."""

REGION: Final = 8_000
"""Terminals of a region at most, about: its segments stay in a core's cache."""

EARLY: Final = 10_000
"""Terminals at least that a tree has before it is split into regions."""

PART: Final = 50
"""A tree is split when it has one in so many of its terminals."""


def suits_regions(options: GrowthOptions, trunk: Trunk | None) -> bool:
    """Whether a tree is grown by regions.

    Not where radii set the viscosity, nor from a trunk, in stages or to given points: a region
    can't know these of the others.
    """
    return (
        options.terminals >= LARGE
        and trunk is None
        and not options.stages
        and options.terminal_points_mm is None
        and options.law_haematocrit < 0.0
    )


@dataclass
class LargeGrowth(TreeGrowth):
    """A tree that is grown by regions once it has its larger branches.

    Attributes
    ----------
    pool : Executor, optional
        Who grows the regions; threads of this process, one a core, by default.
    early : int
        Terminals when the tree is split.
    is_split, is_audited : bool
        Whether the regions are grown, and all segments measured by the final audit.
    """

    pool: Executor | None = None
    early: int = 0
    is_split: bool = False
    is_audited: bool = False

    def start(self) -> None:
        """Place the stem and the first two terminals, in an array for the early tree alone."""
        self.early = max(EARLY, self.goal // PART)
        self.segments = self.segments[: 2 * self.early + 1].copy()
        super().start()

    def grow(self, until: int | None = None) -> None:
        """Grow up to the goal: the regions once, and what is missing over the whole tissue."""
        if not self.is_split:
            super().grow(self.early)
            self._grow_regions()
            self.is_split = True
        super().grow(until)

    def _grow_regions(self) -> None:
        law = self.options.law
        derive_radii(self.segments, self.progress, law, self.scale)
        early = depth_first(self.segments, self.count)[: self.count]
        seed = int(self.random.integers(1 << 62))
        split = split_tree(early, self.tissue, self.goal, REGION, self.sampler.dense, seed)
        store = Store.of(split)
        self._run(split, store, seed)
        self.segments = store.segments
        count = drop_marked(self.segments, len(self.segments), store.gaps())
        refresh_all(self.segments, count, law)
        self.progress["count"], self.progress["terminals"] = count, self.segments["terminals"][0]
        derive_radii(self.segments, self.progress, law, self.scale)

    def _run(self, split: Split, store: Store, seed: int) -> None:
        wall = self.options.clearance_mm
        helds: dict[int, Any] = {}

        def begin(number: int) -> Future[Any]:
            job = region_job(split, store, number, wall)
            helds[number] = job.held
            return pool.submit(grow_region, self.tissue, self.options, self.scale, job, seed)

        def end(number: int, own: Any) -> None:
            store.fill(number, own, helds.pop(number))

        threads = thread_count()
        most = self.pool.parallel if isinstance(self.pool, ClusterPool) else threads + 1
        with nullcontext(self.pool) if self.pool else ThreadPoolExecutor(threads) as pool:
            run_in_order(split.order.tolist(), split.after, begin, end, most)

    def repair(self) -> None:
        """Repair, and audit all anew where the stem has moved."""
        self.is_audited = self.is_audited and not self._stem_is_short()
        super().repair()

    def _too_wide(self, least: float) -> int:
        known = self.segments, self.count, self.index, self.room, least
        if self.is_audited:
            return measure_again(*known)
        self.is_audited = True
        return measure_in_parallel(*known, thread_count())

    def _in_order(self) -> None:
        if not self.is_split:
            super()._in_order()


def thread_count() -> int:
    """Threads that kernels may use, as numba is told."""
    from numba import get_num_threads  # Heavy, and not needed for small trees

    return int(get_num_threads())
