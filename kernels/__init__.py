"""Compiled kernels: the decorators that own numba's flags, and the store on disk."""

from kernels.bare import without_numba
from kernels.beside import helper_thread
from kernels.compile import jit, pjit
from kernels.folder import cache_dir
from kernels.memory import freed_memory_kept, freed_memory_returned

__all__ = [
    "cache_dir",
    "freed_memory_kept",
    "freed_memory_returned",
    "helper_thread",
    "jit",
    "pjit",
    "without_numba",
]
