"""Run background work at lower scheduling priority than a print."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

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
