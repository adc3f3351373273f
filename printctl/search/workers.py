"""Run candidates' evaluations in this process, on this computer's cores or on a Dask cluster."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from threading import Lock
from typing import Any, Final

from printctl.errors import PrintctlError, UsageError
from printctl.search.evaluate import Task, evaluate

Outcome = tuple[int, dict[str, Any]]
"""Number of the task in its list, and what came out: as `evaluate`, or ``{"broken": message}``."""
WAIT_MIN: Final = 10.0
"""For a cluster's workers; its queue may hold them back."""
_EXTRA: Final = (
    "a search on several processes needs Dask: pip install 'printctl[search]', or give "
    "--workers 0 to search in this process"
)


@dataclass(frozen=True)
class Workers:
    """Who grows candidates.

    Attributes
    ----------
    count : int or None
        Processes on this machine; 0 for none but this one, None for one a core.
    scheduler : str or None
        Address of a cluster's scheduler (``tcp://…``, ``tls://…``), in place of processes here.
    wait_min : float
        How long to wait for the scheduler's answer and its first worker, minutes.
    """

    count: int | None = None
    scheduler: str | None = None
    wait_min: float = WAIT_MIN

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.count is not None:
            raise UsageError(
                f"--scheduler {self.scheduler} has workers of its own; leave --workers out"
            )
        if self.scheduler is not None and "://" not in self.scheduler:
            raise UsageError(
                f"--scheduler {self.scheduler} isn't an address; give it as tcp://HOST:8786"
            )

    def outcomes(self, tasks: Sequence[Task]) -> Generator[Outcome]:
        """What becomes of each task, in the order in which they are done.

        Raises
        ------
        UsageError
            When Dask isn't installed.
        PrintctlError
            When the cluster can't be reached.
        """
        if self.count == 0 or not tasks:
            return _here(tasks)
        wanted = self.count or os.cpu_count() or 1
        return _on_dask(tasks, self, min(wanted, len(tasks)))


def _here(tasks: Sequence[Task]) -> Generator[Outcome]:
    for number, task in enumerate(tasks):
        try:
            yield number, evaluate(task)
        except Exception as exc:  # one candidate's fault isn't the search's
            yield number, _broken(exc)


def _broken(exc: BaseException) -> dict[str, Any]:
    kind = "" if isinstance(exc, PrintctlError) else f"{type(exc).__name__}: "
    return {"broken": f"{kind}{exc}"}


_ONE_AT_A_TIME = Lock()


def grow_alone(task: Task) -> dict[str, Any]:
    """`evaluate` on one thread: a machine has a worker for each of its cores.

    A worker with several threads, as clusters start them unless told otherwise, grows one
    candidate at a time: not every threading layer of numba's can be entered twice.
    """
    import numba

    with _ONE_AT_A_TIME:
        numba.set_num_threads(1)
        return evaluate(task)


def leave_interrupts() -> None:
    """Let Ctrl-C reach the search alone, which then ends its workers: they have nothing to say."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _on_dask(tasks: Sequence[Task], who: Workers, count: int) -> Generator[Outcome]:
    try:
        # Optional, and heavy; a local cluster's key is made with cryptography.
        import cryptography  # noqa: F401
        from distributed import as_completed
    except ImportError as exc:
        raise UsageError(_EXTRA) from exc
    with ExitStack() as stack:
        client = _client(stack, who, count)
        # pure=False: the scheduler's memory of another search is none of ours.
        futures = client.map(grow_alone, tasks, pure=False)
        numbers = {future.key: number for number, future in enumerate(futures)}
        for future in as_completed(futures, loop=client.loop):
            failure = future.exception()
            result = future.result() if failure is None else _broken(failure)
            yield numbers[future.key], result
            future.release()


def _client(stack: ExitStack, who: Workers, count: int) -> Any:
    from distributed import Client

    if who.scheduler is None:
        cluster = _local_cluster(stack, count)
        client = stack.enter_context(Client(cluster, set_as_default=False))
        client.run(leave_interrupts)
        return client
    wait_s, waited = 60.0 * who.wait_min, f"{who.wait_min:g} min (--wait-min)"
    try:
        client = stack.enter_context(Client(who.scheduler, timeout=wait_s, set_as_default=False))
    except (OSError, TimeoutError, ValueError, TypeError) as exc:
        raise PrintctlError(
            f"no Dask scheduler answers at {who.scheduler} within {waited} ({exc}); start one "
            "with `dask scheduler`, or check the address"
        ) from exc
    try:
        client.wait_for_workers(1, timeout=wait_s)
    except TimeoutError as exc:
        raise PrintctlError(
            f"the scheduler at {who.scheduler} has no worker after {waited}; start some with "
            f"`dask worker {who.scheduler} --nthreads 1`, or wait longer"
        ) from exc
    return client


def _local_cluster(stack: ExitStack, count: int) -> Any:
    """Start processes of one thread each, that talk through this machine alone.

    A scheduler runs whatever it is sent, and every user of a machine can reach its ports: so
    connections ask for a key that only these processes have, and there is no web page.
    """
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    no_pages: list[str] = []
    routes = {f"distributed.{who}.http.routes": no_pages for who in ("scheduler", "worker")}
    stack.enter_context(dask.config.set(routes))
    cluster = LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        protocol="tls://",
        security=Security.temporary(),
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        silence_logs=40,
    )
    return stack.enter_context(cluster)
