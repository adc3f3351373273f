"""Compiled kernels: the one decorator that owns numba's flags and the cache's key."""

from kernels.compile import cache_dir, jit, pjit

__all__ = ["cache_dir", "jit", "pjit"]
