"""Run the growth of a tree's regions in parallel, each after the neighbours it depends on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any


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
