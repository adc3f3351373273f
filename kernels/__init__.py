"""Compile numerical kernels with numba, and store their machine code on disk.

Goes in: a Python function of arrays and numbers. Comes out: its machine code, kept on disk. Begin
with `compile.py`.
"""

from kernels.compile import jit, pjit, scalar_jit
from kernels.folder import cache_dir
from kernels.helper import helper_thread
from kernels.memory import freed_memory_returned, keep_freed_memory
from kernels.no_numba import without_numba

__all__ = [
    "cache_dir",
    "freed_memory_returned",
    "helper_thread",
    "jit",
    "keep_freed_memory",
    "pjit",
    "scalar_jit",
    "without_numba",
]
