"""Compile kernels before they are called, on all cores.

Numba compiles on one core, and only when a kernel is called. What a kind of work needs is known
(`kernels.needed`), so several processes compile it into the store, and the work only loads it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from typing import Final

from kernels.folder import cache_dir, kernel_of
from kernels.needed import NeededKernel, resolve_name, types_of

_SOURCES: Final = Path(__file__).resolve().parent.parent
_MOST_PROCESSES: Final = 8
"""Each takes about 0.4 GB."""

Told = Callable[[int], None]
"""Is told how many kernels are done."""


def missing(rows: Sequence[NeededKernel]) -> list[NeededKernel]:
    """Return those of ``rows`` for which the store has too few files younger than the source.

    A guess by names and times, in a few ms: keys are known only once all modules are loaded.
    """
    kept = _files_by_kernel()
    listed = Counter(one.kernel for one in rows)
    short = {
        kernel
        for kernel, count in listed.items()
        if sum(time >= _changed(kernel) for time in kept.get(_file_stem(kernel), ())) < count
    }
    return [one for one in rows if one.kernel in short]


def processes() -> int:
    """Return how many processes compile at once: one for each core, at most eight."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(cores or 1, _MOST_PROCESSES)


def compile_in_advance(rows: Sequence[NeededKernel], told: Told = lambda done: None) -> int:
    """Compile ``rows`` into the store; return how many couldn't be.

    Those are left to their first call, which compiles them or says what is wrong.
    """
    # Spawned: a fork of a process with numba's threads may hang.
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes(), spawn, initializer=_leave_interrupts)
    failed = len(rows)
    try:
        waiting = [pool.submit(_compiled, one.kernel, one.takes) for one in rows]
        with suppress(BrokenProcessPool):
            for done, one in enumerate(as_completed(waiting), 1):
                failed -= one.result()
                told(done)
    finally:
        pool.shutdown(cancel_futures=True)
    _mark_as_checked(rows)
    return failed


def _leave_interrupts() -> None:
    """Let the parent alone answer Ctrl-C; it ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compiled(kernel: str, takes: str) -> bool:
    try:
        resolve_name(kernel).compile(types_of(takes))
    except Exception:  # whatever numba raises for a list that is out of date
        return False
    return True


def _mark_as_checked(rows: Sequence[NeededKernel]) -> None:
    """Give files of these kernels a time after their sources', so that they count as looked at."""
    stems = {_file_stem(one.kernel) for one in rows}
    for path in _files():
        if kernel_of(path) in stems:
            with suppress(OSError):
                os.utime(path)


def _files_by_kernel() -> dict[str, list[float]]:
    kept: dict[str, list[float]] = {}
    for path in _files():
        with suppress(OSError):
            kept.setdefault(kernel_of(path), []).append(path.stat().st_mtime)
    return kept


def _files() -> list[Path]:
    try:
        return list(cache_dir().glob("*.nbc"))
    except OSError:
        return []


def _file_stem(kernel: str) -> str:
    return kernel.replace(":", ".")


def _changed(kernel: str) -> float:
    """When the source of a kernel was last changed; never, where there is no such file."""
    place = _SOURCES.joinpath(*kernel.partition(":")[0].split("."))
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        with suppress(OSError):
            return path.stat().st_mtime
    return 0.0
