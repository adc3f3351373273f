"""Compile kernels by numba, with the same compiler flags for every kernel of the product.

Flags, and why:

- kept on disk (`kernels.stored`): compiled once and then loaded, under a key that holds everything
  that the machine code depends on (`kernels.key`).
- no ``fastmath``: NaN and inf must keep their meaning; a NaN in a network is refused, not
  optimised away.
- ``nogil=True``: a kernel touches no Python object, so threads (progress bars, the link's stop
  path) go on while it runs.
- ``error_model="numpy"``: division by zero gives inf or NaN, as in NumPy, and costs no branch.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from typing import Any

# Threads that wait for a kernel's next loop would spin and keep their core from what goes on
# beside; OpenMP reads this once, when numba loads it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from kernels.dispatcher import KernelDispatcher
from kernels.library import use_waiting_libraries


def _list_array_functions() -> None:
    """Import numba's array functions, which loads scipy's BLAS only to know whether it is there.

    That takes 0.2 s of each process and 20 MB. It is there, and a kernel that multiplies matrices
    loads it when it is compiled or called; tests/kernels holds both.
    """
    linalg: Any = import_module("numba.np.linalg")
    load, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = load


_list_array_functions()
use_waiting_libraries()


def compiled(function: Callable[..., Any], **flags: bool) -> Any:
    """Return numba's dispatcher of a kernel, which keeps what it compiles on disk."""
    options = {"nopython": True, "boundscheck": None, "nogil": True, "error_model": "numpy"}
    return KernelDispatcher(function, targetoptions=options | flags)
