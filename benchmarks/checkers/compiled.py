"""Compiler settings of the checkers, independent of the product's.

Numba's cache knows a function's own file but not its callees', so it lives in a folder named by a
hash of all files of this package.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


@cache
def _folder() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return str(Path.home() / ".cache" / "printctl-bench" / "checkers" / digest.hexdigest()[:16])


def compiled(function: F) -> F:
    """Compile one kernel, single-threaded, no fastmath."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _folder()
    try:
        done: F = numba.njit(cache=True, error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR = before
    return done
