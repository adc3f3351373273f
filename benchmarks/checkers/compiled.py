"""Compiler settings of the checkers, independent of the product's.

Numba's cache knows a function's own file but not its callees', so it lives in a folder named by a
hash of all files of this package: the same one for each clone that has the same files.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import UserProvidedCacheLocator

F = TypeVar("F", bound=Callable[..., Any])


@cache
def _folder() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return str(Path.home() / ".cache" / "printctl-bench" / "checkers" / digest.hexdigest()[:16])


class OneFolder(UserProvidedCacheLocator):
    """Numba's cache in `_folder`, not in a folder below it that is named by the clone's path."""

    def get_cache_path(self) -> str:
        """Return the folder."""
        return _folder()


def compiled(function: F) -> F:
    """Compile one kernel, single-threaded, no fastmath."""
    before = numba.config.CACHE_DIR, getattr(numba.config, "CACHE_LOCATOR_CLASSES", "")
    numba.config.CACHE_DIR = _folder()
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{OneFolder.__name__}"
    try:
        done: F = numba.njit(cache=True, error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = before
    return done
