"""Grow a tree of 100,000+ terminals: serially to 10,000 or 2 % of them, then region by region."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.tissue import Tissue
from design.vasculature.growth.checks import (
    allowed_radius,
    drop_marked,
    limit_joints,
    measure_changed,
    too_wide,
)
from design.vasculature.growth.cost import depth_first, refresh_all
from design.vasculature.growth.index import CellIndex, Clearances
from design.vasculature.growth.kernel import derive_radii
from design.vasculature.growth.region_growth import Store, grow_region, region_job
from design.vasculature.growth.region_split import Split, split_tree
from design.vasculature.growth.tree import TreeGrowth
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions
from kernels import scalar_jit

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


# Run the growth of a tree's regions in parallel, each after the neighbours it depends on.


def run_in_order(
    order: Iterable[int],
    after: list[set[int]],
    begin: Callable[[int], Future[Any]],
    end: Callable[[int, Any], None],
    most: int,
) -> None:
    """Begin tasks in order, as soon as those that each comes after have ended.

    Parameters
    ----------
    order : iterable of int
    after : list of set of int
        For each task those before it; all of them come earlier in ``order``.
    begin : function of a task
    end : function of a task and its result
        Called in this thread.
    most : int
        Tasks under way at a time.
    """
    waiting = list(order)
    done: set[int] = set()
    running: dict[Future[Any], int] = {}
    try:
        while waiting or running:
            ready = [task for task in waiting if after[task] <= done][: most - len(running)]
            for task in ready:
                running[begin(task)] = task
            waiting = [task for task in waiting if task not in ready]
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                task = running.pop(future)
                end(task, future.result())
                done.add(task)
    finally:
        for future in running:
            future.cancel()


# Executor that grows a large tree's regions on a Dask cluster.

_EACH = 2
"""Tasks under way for each thread of a worker, so that none waits for the next message."""


class ClusterPool(Executor):
    """Executor on a Dask client's workers, which get the tissue once and not with every task.

    The workers need this version of the sources, and one thread each: `demand` images are read by
    kernels of several threads.

    Parameters
    ----------
    client : distributed.Client
        Stays the caller's, who closes it.

    Attributes
    ----------
    parallel : int
        Tasks that may be under way at a time.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._pool = client.get_executor(pure=False)
        self._sent: dict[int, tuple[Tissue, Any]] = {}
        self.parallel = _EACH * max(1, sum(client.nthreads().values()))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a function on a worker."""
        done: Future[Any] = self._pool.submit(fn, *map(self._there, args), **kwargs)
        return done

    def _there(self, value: Any) -> Any:
        """A value as workers take it: of a tissue what stands for it there."""
        if not isinstance(value, Tissue):
            return value
        if id(value) not in self._sent:
            sent = self._client.scatter(value, broadcast=True, hash=False)
            self._sent[id(value)] = value, sent
        return self._sent[id(value)][1]


_AT_A_TIME = 50_000
"""Segments that a thread measures before it takes more."""
LARGER, SMALLER = 1.03, 0.85
"""A segment's room is measured anew once its radius is beyond these parts of what it was.

Between them the search for neighbours reached far enough: `index.REACH` times the smaller one is
above the larger one squared, with the clearance ratio of a tenth."""


def measure_again(
    segments: Any, count: int, index: CellIndex, room: Clearances, smallest: float
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
    measure_changed(segments, count, index, room, smallest, False)
    limit_joints(segments, count, room)
    return int(too_wide(segments, count))


@scalar_jit
def mark_changed(segments: Any, count: int) -> None:
    """Allow any radius to what must be measured anew: that is what `measure_changed` looks for."""
    for i in range(count):
        s = segments[i]
        alike = SMALLER * s.audited < s.radius < LARGER * s.audited
        if not alike or s.radius > s.allowed or s.allowed == np.inf:
            s.allowed, s.audited = np.inf, s.radius


def measure_in_parallel(
    segments: Any, count: int, index: CellIndex, room: Clearances, smallest: float, threads: int
) -> int:
    """Derive allowed radii as `growth.checks.measure_allowed_radii` with joints does.

    Every segment is measured by itself, so that the result doesn't depend on the threads.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    # Without a reserve the search for neighbours goes on to the nearest.
    alone = room._replace(reserve=0.0)

    def measure(begin: int) -> None:
        own = index._replace(stamp=np.zeros_like(index.stamp), query=np.zeros_like(index.query))
        end = min(begin + _AT_A_TIME, count)
        measure_alone(segments, begin, end, own, alone, smallest)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(measure, range(0, count, _AT_A_TIME)))
    limit_joints(segments, count, room)
    return int(too_wide(segments, count))


@scalar_jit
def measure_alone(
    segments: Any, begin: int, end: int, index: CellIndex, room: Clearances, smallest: float
) -> None:
    """Derive the allowed radii of segments ``begin`` to ``end`` from tissue and neighbours."""
    for i in range(begin, end):
        s = segments[i]
        s.allowed, s.audited = np.inf, s.radius
        if s.given != 0:
            continue
        s.allowed = allowed_radius(segments, i, index, room, False)
        if s.left < 0 and s.radius < smallest:
            s.allowed = min(s.allowed, 0.0)
