"""Compile every numerical kernel by numba, single-threaded or parallel, with the same flags.

Flags, and why:

- a `KernelCache`: compiled once and then loaded from disk. The folder (`kernels.folder`) is named
  by a digest of all source files that a kernel can see: numba's own key misses a function called
  from another file, and constants that stand there.
- no ``fastmath``: NaN and inf must keep their meaning; a NaN in a network is refused, not
  optimised away.
- ``nogil=True``: a kernel touches no Python object, so threads (progress bars, the link's stop
  path) go on while it runs.
- ``error_model="numpy"``: division by zero gives inf or NaN, as in NumPy, and costs no branch.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

# Threads that wait for a kernel's next loop would spin and keep their core from what goes on
# beside; OpenMP reads this once, when numba loads it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numba

from kernels.stored import KernelCache

F = TypeVar("F", bound=Callable[..., Any])

numba.config.CACHE_LOCATOR_CLASSES = (
    "kernels.locator.KernelLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator"
)


def jit(function: F) -> F:
    """Compile a single-threaded kernel."""
    return _compile(function)


def scalar_jit(function: F) -> F:
    """Compile a kernel that makes no array and returns none, without counting references.

    Numba counts who holds an array each time that one is named, by an operation that other cores
    see and that the optimiser can't move loads across: a fifth of the time of growing a tree. Here
    arrays are the caller's until the kernel has ended. Numba refuses a kernel that makes one; one
    that returned an array would hand on memory that may be gone.
    """
    return _compile(function, _nrt=False)


def pjit(function: F) -> F:
    """Compile a kernel whose ``numba.prange`` loops run on all threads.

    Only for loops whose result doesn't depend on the number of threads (each iteration writes
    its own place; no floating-point reduction across iterations).
    """
    return _compile(function, parallel=True)


def _compile(function: F, **flags: bool) -> F:
    # Said for every kernel: numba hands a caller's flag down to callees that say nothing.
    flags = {"_nrt": True, **flags}
    compiled: Any = numba.njit(nogil=True, error_model="numpy", **flags)(function)
    compiled._cache = KernelCache(function)
    return cast(F, compiled)
