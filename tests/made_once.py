"""Values that take seconds, made once for all of pytest's workers."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

try:
    import fcntl
except ImportError:  # not on Windows: each worker makes its own
    fcntl = None  # type: ignore[assignment]

T = TypeVar("T")


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[], T]) -> T:
    """Return what ``make`` gives, as a copy of what the first worker that asked has made.

    Parameters
    ----------
    factory : pytest.TempPathFactory
        Whose folder the workers of a run share.
    name : str
        One for each value.
    make : callable
        Gives a value that can be pickled.
    """
    folder = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    path = folder / f"{name}.pickle"
    with (folder / f"{name}.lock").open("w") as lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            _write(path, pickle.dumps(make()))
        value: T = pickle.loads(path.read_bytes())
    return value


def _write(path: Path, content: bytes) -> None:
    scratch = path.with_suffix(f".{os.getpid()}")
    scratch.write_bytes(content)
    scratch.replace(path)
