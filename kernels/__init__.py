"""Compiled kernels: the decorators that own numba's flags, and the store on disk."""

from kernels.beside import beside
from kernels.compile import jit, pjit
from kernels.stored import cache_dir

__all__ = ["beside", "cache_dir", "jit", "pjit"]
