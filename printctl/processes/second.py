"""Call functions in a second Python process, without blocking this one."""

from __future__ import annotations

import multiprocessing
import multiprocessing.context
import os
import signal
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from importlib import import_module
from threading import Thread
from types import TracebackType
from typing import Any


class SecondProcess:
    """Imports modules and calls their functions in a process of its own, one after another.

    Plotting libraries hold the interpreter's lock while they load and draw; a thread would keep
    from work what it is to do beside it. Where no second process can run, or when it ends early,
    the call is made here, when its result is asked for. Leave it by ``with``.

    Parameters
    ----------
    module : str or None
        To be imported at once, before the first call.
    """

    def __init__(self, module: str | None = None) -> None:
        self._pool = ProcessPoolExecutor(1, _context(), initializer=_set_up)
        if module is not None:
            with suppress(BrokenProcessPool, OSError):
                self._pool.submit(_load, module)

    def __enter__(self) -> SecondProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        exc: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown(wait=exc is None, cancel_futures=True)

    def call(self, module: str, function: str, *arguments: Any) -> Call:
        """Begin a call; arguments and result go through pickle."""
        try:
            begun = self._pool.submit(_work, module, function, arguments)
        except (BrokenProcessPool, OSError):
            begun = None
        return Call(begun, (module, function, arguments))


class Call:
    """Function call running in the second process."""

    def __init__(self, begun: Future[Any] | None, work: tuple[str, str, tuple[Any, ...]]) -> None:
        self._begun, self._what = begun, work

    def result(self) -> Any:
        """Wait for what the function returns; raise what it raises."""
        try:
            return _work(*self._what) if self._begun is None else self._begun.result()
        except BrokenProcessPool:
            return _work(*self._what)


def _context() -> multiprocessing.context.BaseContext:
    """Fork, which imports nothing twice, where no thread could hold a lock; else spawn."""
    return multiprocessing.get_context("fork" if _is_alone() else "spawn")


def _is_alone() -> bool:
    """Whether this process has one thread, libraries' own among them; told by Linux alone."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


def _set_up() -> None:
    """Leave Ctrl-C to the first process, which says what it means, and end where that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_first, daemon=True).start()


def _end_with_first() -> None:
    """Leave no process behind that holds the output open, however the first one ends."""
    first = multiprocessing.parent_process()
    if first is not None:
        first.join()
        os._exit(1)


def _load(module: str) -> None:
    import_module(module)


def _work(module: str, function: str, arguments: tuple[Any, ...]) -> Any:
    return getattr(import_module(module), function)(*arguments)
