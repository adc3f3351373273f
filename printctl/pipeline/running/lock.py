"""Lock a run folder for one process, so that one run at a time works in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from printctl.errors import PrintctlError


@contextmanager
def run_lock(folder: Path) -> Iterator[None]:
    """Hold ``folder`` for this process; the system lets go of it when the process dies.

    Raises
    ------
    PrintctlError
        When another live process runs in the folder.
    """
    folder.mkdir(0o700, parents=True, exist_ok=True)
    try:
        # The page's server looks now and then whether the lock is held; that takes a moment.
        with FileLock(folder / ".lock", timeout=0.5):
            yield
    except Timeout as exc:
        raise PrintctlError(
            f"another printctl runs in {folder}; wait for it, or give another --out"
        ) from exc


def is_run_active(folder: Path) -> bool:
    """Whether a live process runs in ``folder``."""
    if not (folder / ".lock").is_file():
        return False
    try:
        with FileLock(folder / ".lock", timeout=0):
            return False
    except Timeout:
        return True
