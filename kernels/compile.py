"""Decorators that compile every numerical kernel, single-threaded or parallel."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar

from kernels.no_numba import BareKernel, bare_wanted

F = TypeVar("F", bound=Callable[..., Any])


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
    kernel: Any
    if bare_wanted() and "parallel" not in flags:
        kernel = BareKernel(function, flags)
    else:  # Loads numba, 0.3 CPU s and 90 MB
        kernel = import_module("kernels.with_numba").compiled(function, **flags)
    made: F = kernel
    return made
