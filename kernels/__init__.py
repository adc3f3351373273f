"""Compiled kernels: the decorators that own numba's flags, and the store on disk."""

from kernels.beside import beside
from kernels.compile import jit, pjit
from kernels.memory import freed_memory_kept
from kernels.stored import cache_dir

__all__ = ["beside", "cache_dir", "freed_memory_kept", "jit", "pjit"]
