"""Compile numerical kernels with numba, and store their machine code on disk.

Goes in: a Python function of arrays and numbers. Comes out: its machine code, kept on disk. Begin
with `compile.py`.
"""

from typing import TYPE_CHECKING, Any

from kernels.folder import cache_dir
from kernels.helper import helper_thread
from kernels.memory import freed_memory_returned, keep_freed_memory

if TYPE_CHECKING:
    from kernels.compile import jit, pjit, scalar_jit

__all__ = [
    "cache_dir",
    "freed_memory_returned",
    "helper_thread",
    "jit",
    "keep_freed_memory",
    "pjit",
    "scalar_jit",
]


def __getattr__(name: str) -> Any:
    """Load numba (0.5 CPU s, 110 MB) once a decorator is used: array types alone need none."""
    if name not in ("jit", "pjit", "scalar_jit"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from kernels import compile as decorators

    return getattr(decorators, name)
