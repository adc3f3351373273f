"""Run a blocking call in a thread and return its result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from nicegui import run

T = TypeVar("T")


async def run_in_thread(work: Callable[..., T], *args: Any) -> T:
    """Call ``work`` in a thread; what it raises is raised here."""
    return cast(T, await run.io_bound(work, *args))
