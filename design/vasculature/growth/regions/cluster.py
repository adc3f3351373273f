"""Executor that grows a large tree's regions on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from design.tissue import Tissue

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
