"""The decorators under which every numerical kernel of the product is compiled.

Flags, and why:

- ``cache=True``: compiled once, when the environment is made (``printctl doctor --warm``), and
  then loaded from disk.
- no ``fastmath``: NaN and inf must keep their meaning; a NaN in a network is refused, not
  optimised away.
- ``nogil=True``: a kernel touches no Python object, so threads (progress bars, the link's stop
  path) go on while it runs.
- ``error_model="numpy"``: division by zero gives inf or NaN, as in NumPy, and costs no branch.

Numba keys its cache on the source file of the decorated function alone, and so misses a callee
changed in another file. Here the cache lives in a folder named by a hash of *all* kernel sources.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("kernels", "design", "sim", "registration")


@cache
def source_key() -> str:
    """Hash of every source file that takes part in a kernel, 16 hex digits."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            text = path.read_bytes()
            if b"kernels" in text:
                digest.update(str(path.relative_to(_ROOT)).encode() + text)
    return digest.hexdigest()[:16]


@cache
def cache_dir() -> Path:
    """Folder of the compiled kernels, by source hash, below the user's cache.

    ``PRINTCTL_CACHE`` moves it (the Makefile puts it into the virtual environment).
    """
    base = os.environ.get("PRINTCTL_CACHE")
    root = Path(base) if base else Path.home() / ".cache" / "printctl"
    return root / "kernels" / source_key()


def _compile(function: F, **flags: bool) -> F:
    numba.config.CACHE_DIR = str(cache_dir())
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy", **flags)(function)
    return compiled


def jit(function: F) -> F:
    """Compile a single-threaded kernel."""
    return _compile(function)


def pjit(function: F) -> F:
    """Compile a kernel whose ``numba.prange`` loops run on all threads.

    Only for loops whose result doesn't depend on the number of threads (each iteration writes
    its own place; no floating-point reduction across iterations).
    """
    return _compile(function, parallel=True)
