"""Compile kernels in several processes before they are first called.

Numba compiles on one core, and only when a kernel is called. `needed.jsonl` lists what each kind of
work calls, callees before callers (``python -m tests.kernels.record`` writes it anew). A kernel
that isn't listed is compiled when it is first called.
"""

from __future__ import annotations

import gc
import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from kernels.folder import kernel_folder

LIST: Final = Path(__file__).with_name("needed.jsonl")
_COMPILED: Final = "compiled.txt"
_MAX_PROCESSES: Final = 8
"""Each takes about 0.4 GB."""
_MAX_OBJECTS: Final = 1_000_000
"""New objects after which a process that compiles collects garbage, about 0.3 GB of it. Python
does so after each 700, which took an eighth of the compiling time."""


@dataclass(frozen=True)
class NeededKernel:
    """A kernel and the argument types that it is compiled for.

    Attributes
    ----------
    kernel : str
        Module and function, with a colon between.
    takes : str
        Argument types as JSON (`numba_type`).
    by : frozenset of str
        The kinds of work that need it: ``run fresh``, ``register`` and so on.
    """

    kernel: str
    takes: str
    by: frozenset[str]


def needed_kernels(*works: str) -> list[NeededKernel]:
    """Return what ``works`` need; with none given all that is listed. Empty without the list."""
    lines = LIST.read_text(encoding="utf-8").splitlines() if LIST.is_file() else []
    if works:
        lines = [line for line in lines if any(f'"{work}"' in line for work in works)]
    rows = [
        NeededKernel(one["kernel"], json.dumps(one["takes"]), frozenset(one["by"]))
        for one in map(json.loads, lines)
    ]
    return [one for one in rows if not works or one.by & set(works)]


def missing(rows: Sequence[NeededKernel]) -> list[NeededKernel]:
    """Return those of ``rows`` that haven't been compiled ahead for these sources."""
    path = kernel_folder() / _COMPILED
    done = set(path.read_text(encoding="utf-8").splitlines()) if path.is_file() else set()
    return [one for one in rows if f"{one.kernel} {one.takes}" not in done]


def processes() -> int:
    """Return how many processes compile at once: one for each core, at most eight."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(cores or 1, _MAX_PROCESSES)


_late: set[Future[bool]] = set()
"""What this process's `compiling` still compiles beside it."""


def wait_for_late() -> None:
    """Wait until ``late`` kernels of `compiling` are done; calling one would compile it twice."""
    wait(_late)


@contextmanager
def compiling(
    rows: Sequence[NeededKernel],
    late: Sequence[NeededKernel] = (),
    report: Callable[[int], None] = lambda done: None,
) -> Iterator[int]:
    """Compile ``rows`` into the store, then ``late`` while the body runs.

    Gives the body how many of ``rows`` couldn't be compiled. Those, and what of ``late`` isn't done
    when the body ends, are left to their first call, which compiles them or says what is wrong.
    ``report`` is called with the number of ``rows`` done.
    """
    # Spawned: a fork of a process with numba's threads may hang.
    spawn = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes(), spawn, initializer=_begin)
    waiting = {pool.submit(_compile, one.kernel, one.takes): one for one in rows}
    after = {pool.submit(_compile, one.kernel, one.takes, True): one for one in late}
    workers = set(multiprocessing.active_children()) - others  # not those that the body starts
    _late.update(after)
    failed = len(rows)
    try:
        with suppress(BrokenProcessPool):
            for done, future in enumerate(as_completed(waiting), 1):
                failed -= future.result()
                report(done)
        yield failed
    finally:
        # They ignore Ctrl-C, and a kernel takes seconds.
        for worker in workers:
            worker.terminate()
        pool.shutdown(cancel_futures=True)
        _late.clear()
        both = (waiting | after).items()
        compiled = [row for one, row in both if _is_compiled(one)]
        with suppress(OSError), open(kernel_folder() / _COMPILED, "a", encoding="utf-8") as file:
            file.writelines(f"{one.kernel} {one.takes}\n" for one in compiled)


def _is_compiled(one: Future[bool]) -> bool:
    return one.done() and not one.cancelled() and one.exception() is None and one.result()


def _begin() -> None:
    """Let the parent alone answer Ctrl-C; collect no garbage while compiling."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()


def _compile(kernel: str, takes: str, late: bool = False) -> bool:
    if late and hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, 0, 10)  # what waits for it works at the same time
    try:
        module, _, name = kernel.partition(":")
        types = tuple(numba_type(one) for one in json.loads(takes))
        getattr(import_module(module), name).compile(types)
    except Exception:  # whatever numba raises for a list that is out of date
        return False
    if gc.get_count()[0] > _MAX_OBJECTS:
        gc.collect()
    return True


def numba_type(data: Any) -> Any:
    """Return the numba type that a row of the list describes (`tests.kernels.record.described`)."""
    from numba import from_dtype, types  # loaded by processes that compile, alone

    if isinstance(data, str):
        return getattr(types, data)
    ((kind, value),) = data.items()
    if kind == "bytes":
        return types.Bytes(getattr(types, value), 1, "C")
    if kind == "array":
        dtype, ndim, layout, *flags = value
        return types.Array(numba_type(dtype), ndim, layout, readonly="readonly" in flags)
    if kind == "tuple":
        return types.BaseTuple.from_types([numba_type(one) for one in value])
    if kind == "named":
        module, _, name = value[0].partition(":")
        named = getattr(import_module(module), name)
        return types.BaseTuple.from_types([numba_type(one) for one in value[1]], named)
    size, aligned, fields = value
    names, forms, shapes, offsets = zip(*fields, strict=True)
    formats = [(form, tuple(shape)) for form, shape in zip(forms, shapes, strict=True)]
    parts: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    return from_dtype(np.dtype(parts, align=aligned))
