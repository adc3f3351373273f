"""Work in processes of low priority."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from typing import Final, TypeVar

from printctl.sources import python_command
from printctl.web.errors import ConflictError

_LATER: Final = 10
T = TypeVar("T")
NOW, BEHIND = "now", "behind"
"""When something is done, as one process tells another."""


def lower_priority(niceness: int = _LATER) -> None:
    """Let what this thread does run behind a print; for good, since only root may step forward.

    Outside Linux it is the whole process; on Windows, which has no such thing, nothing happens.
    """
    with contextlib.suppress(AttributeError, OSError):  # no os.nice on Windows
        os.nice(max(niceness - os.nice(0), 0))


def run_at_low_priority(work: Callable[[], T]) -> T:
    """Do something in a thread of its own that has stepped back; what is done later hasn't."""
    with ThreadPoolExecutor(1, initializer=lower_priority) as behind:
        return behind.submit(work).result()


def run_worker(
    module: str, *words: str, said: str = "", longest_s: float, late: str, died: str
) -> str:
    """Run a module of ours to its end and give what it printed.

    Parameters
    ----------
    module : str
        Has a ``main``.
    *words : str
        Its arguments.
    said : str
        What it is given to read.
    longest_s : float, s
    late, died : str
        What a person is told when it takes longer, or ends in failure; the last line that it
        wrote to stderr is added to ``died``.

    Raises
    ------
    ConflictError
    """
    try:
        done = subprocess.run(
            [*python_command(__name__), module, *words],
            input=said,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=longest_s,
            check=False,
        )
    except subprocess.TimeoutExpired as exc:
        raise ConflictError(late) from exc
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no word"]
        raise ConflictError(f"{died}: {last[0][:500]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(import_module(sys.argv.pop(1)).main())
