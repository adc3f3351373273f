"""Compile kernels into the store in several processes, before they are first called.

Numba compiles on one core, and only when a kernel is called. What a kind of work needs is known
(`kernels.needed`), so several processes compile it into the store, and the work only loads it.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from kernels.folder import ALL, FOR_KERNELS, cache_dir, kernel_of
from kernels.needed import NeededKernel, resolve_name, types_of
from kernels.under_way import expect, expect_no_more

_SOURCES: Final = Path(__file__).resolve().parent.parent
_MOST_PROCESSES: Final = 8
"""Each takes about 0.4 GB."""

_MOST_OBJECTS: Final = 1_000_000
"""New objects after which a process that compiles looks for those in circles, about 0.3 GB of them.
Python looks after each 700, which took an eighth of the compiling time."""

Told = Callable[[int], None]
"""Is told how many kernels are done."""


def missing(rows: Sequence[NeededKernel]) -> list[NeededKernel]:
    """Return those of ``rows`` for which the store has too few files younger than the source.

    A guess by names and times, in a few ms: keys are known only once all modules are loaded.
    """
    kept = _files_by_kernel()
    listed = Counter(one.kernel for one in rows)
    entries = Counter(one.kernel for one in rows if one.entry)
    short = set()
    for kernel, count in listed.items():
        young = [one for one in kept.get(_file_stem(kernel), ()) if one.changed >= _changed(kernel)]
        if len(young) < count or sum(one.entry for one in young) < entries[kernel]:
            short.add(kernel)
    return [one for one in rows if one.kernel in short]


def processes() -> int:
    """Return how many processes compile at once: one for each core, at most eight."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(cores or 1, _MOST_PROCESSES)


@contextmanager
def compiling(
    rows: Sequence[NeededKernel], beside: Sequence[NeededKernel], tell: Told = lambda done: None
) -> Iterator[int]:
    """Compile ``rows`` into the store; go on with ``beside`` while the caller is at work.

    Yields how many of ``rows`` couldn't be compiled. Those are left to their first call, which
    compiles them or says what is wrong. A call of a kernel of ``beside`` waits for it. What isn't
    done when the caller has ended isn't compiled.
    """
    # Spawned: a fork of a process with numba's threads may hang.
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes(), spawn, initializer=_begin)
    others = set(multiprocessing.active_children())
    waiting = [pool.submit(_compiled, one.kernel, one.takes, one.entry) for one in (*rows, *beside)]
    workers = set(multiprocessing.active_children()) - others
    first, later = waiting[: len(rows)], waiting[len(rows) :]
    try:
        expect(beside, later)
        failed = len(rows)
        with suppress(BrokenProcessPool):
            for done, one in enumerate(as_completed(first), 1):
                failed -= one.result()
                tell(done)
        _mark_as_checked(rows)
        yield failed
        if all(one.done() for one in later):
            _mark_as_checked(beside)
    finally:
        expect_no_more()
        if not all(one.done() for one in waiting):
            # They ignore Ctrl-C, and a kernel takes seconds.
            for worker in workers:
                worker.terminate()
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """Let the parent alone answer Ctrl-C; it ends the others. Clear memory between kernels only."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()


def _compiled(kernel: str, takes: str, entry: bool) -> bool:
    try:
        dispatcher, types = resolve_name(kernel), types_of(takes)
        if entry:
            dispatcher.compile(types)
        else:
            dispatcher.compile_for_kernels(types)
    except Exception:  # whatever numba raises for a list that is out of date
        return False
    if gc.get_count()[0] > _MOST_OBJECTS:
        gc.collect()
    return True


def _mark_as_checked(rows: Sequence[NeededKernel]) -> None:
    """Give files of these kernels a time after their sources', so that they count as looked at."""
    stems = {_file_stem(one.kernel) for one in rows}
    for path in _files():
        if kernel_of(path) in stems:
            with suppress(OSError):
                os.utime(path)


class _File(NamedTuple):
    changed: float
    entry: bool


def _files_by_kernel() -> dict[str, list[_File]]:
    kept: dict[str, list[_File]] = {}
    for path in _files():
        with suppress(OSError):
            one = _File(path.stat().st_mtime, not path.name.endswith(FOR_KERNELS))
            kept.setdefault(kernel_of(path), []).append(one)
    return kept


def _files() -> list[Path]:
    try:
        return list(cache_dir().glob(f"*{ALL}"))
    except OSError:
        return []


def _file_stem(kernel: str) -> str:
    return kernel.replace(":", ".")


def _changed(kernel: str) -> float:
    """When the source of a kernel, or what makes keys, was last changed; never without a file."""
    place = _SOURCES.joinpath(*kernel.partition(":")[0].split("."))
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        with suppress(OSError):
            return max(path.stat().st_mtime, _keys_changed())
    return 0.0


@cache
def _keys_changed() -> float:
    """When this package was last changed; files of former keys don't count."""
    return max(path.stat().st_mtime for path in Path(__file__).parent.glob("*.py"))
