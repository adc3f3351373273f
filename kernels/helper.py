"""Executor with a helper thread if numba's threading layer allows it, else in the same thread."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")

_SAFE = ("tbb", "omp")
"""Numba's threading layers that two threads may use at once (Numba's manual, The Threading
Layers); its own, "workqueue", stops the program."""


def helper_thread() -> Executor:
    """One thread that works beside the caller's; the caller's own where two may not.

    Which layer there is, is known once a parallel kernel has run.
    """
    import numba  # loaded long since, where a parallel kernel has run

    try:
        layer = numba.threading_layer()
    except ValueError:
        layer = "unknown"
    return ThreadPoolExecutor(1) if layer in _SAFE else _AtOnce()


class _AtOnce(Executor):
    """Does the work when it is handed in."""

    def submit(self, work: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        done: Future[T] = Future()
        try:
            done.set_result(work(*args, **named))
        except Exception as exc:
            done.set_exception(exc)
        return done
