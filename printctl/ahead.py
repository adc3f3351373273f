"""Work done while something else is computed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import Future
from importlib import import_module
from threading import Thread
from typing import Any

_SWITCH_S = 0.0005
"""How long a thread may hold the interpreter while another waits: ten times less than usual, so
that short kernels between lines of Python don't wait long for it."""


def call_ahead(module: str, function: str, *arguments: Any) -> Future[Any]:
    """Import `module` and call its `function` beside what goes on.

    Kernels don't hold the interpreter's lock, so plotting libraries load and draw while they run.
    What goes wrong shows where the result is asked for.
    """
    sys.setswitchinterval(_SWITCH_S)
    done: Future[Any] = Future()
    Thread(target=_work, args=(done, module, function, arguments), daemon=True).start()
    return done


def _work(done: Future[Any], module: str, function: str, arguments: tuple[Any, ...]) -> None:
    try:
        work: Callable[..., Any] = getattr(import_module(module), function)
        done.set_result(work(*arguments))
    except Exception as exc:
        done.set_exception(exc)
