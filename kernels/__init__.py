"""Compiled kernels: the decorators that own numba's flags, and the store on disk."""

from kernels.compile import jit, pjit
from kernels.folder import cache_dir
from kernels.helper_thread import helper_thread
from kernels.memory import freed_memory_returned, keep_freed_memory
from kernels.without_numba import without_numba

__all__ = [
    "cache_dir",
    "freed_memory_returned",
    "helper_thread",
    "jit",
    "keep_freed_memory",
    "pjit",
    "without_numba",
]
