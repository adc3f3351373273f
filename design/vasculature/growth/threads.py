"""Grow regions of a tree in threads of this process, or in those of other programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any, NamedTuple

from design.tissue import Tissue


class ParallelSettings(NamedTuple):
    """Sizes of tasks, and when an audit is repeated."""

    tasks_per_thread: int = 2
    """Tasks under way for each thread of a worker, so that none waits for the next message."""
    segments_per_task: int = 50_000
    """Segments that a thread measures before it takes more."""
    min_radius_ratio: float = 0.85
    max_radius_ratio: float = 1.03
    """A segment is measured anew once its radius is beyond these parts of the audited one.
    Between them the search for neighbours reached far enough: `index.REACH` times the first is
    above the second squared, with the clearance ratio of a tenth."""


PARALLEL = ParallelSettings()


def thread_count() -> int:
    """Threads that kernels may use, as numba is told."""
    from numba import get_num_threads  # Heavy, and not needed for small trees

    return int(get_num_threads())


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
        self.parallel = PARALLEL.tasks_per_thread * max(1, sum(client.nthreads().values()))

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
