"""Reuse freed memory for large arrays that are allocated one after another."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _MMAP_MAX = -1, -3, -4
"""Parameters of glibc's ``mallopt`` (malloc.h)."""
_KEPT: Final = ((_MMAP_MAX, 0), (_TRIM_THRESHOLD, 1 << 30))
_USUAL: Final = ((_MMAP_MAX, 1 << 16), (_MMAP_THRESHOLD, 32 << 20), (_TRIM_THRESHOLD, 64 << 20))
"""What glibc's thresholds grow to by themselves in a process that frees large arrays."""


@contextmanager
def freed_memory_kept() -> Iterator[None]:
    """Have large arrays take the place of freed ones; give free memory back at the end.

    Glibc maps every array above 32 MB anew and unmaps it when it is freed, and the kernel clears
    each of its pages again. Where a hundred such arrays follow each other, that takes a tenth of
    the time. For work in one thread: what several threads keep adds up. C libraries without
    ``mallopt`` (macOS, musl) go on as they are.
    """
    library = _glibc()
    if library is None:
        yield
        return
    try:
        for parameter, value in _KEPT:
            library.mallopt(parameter, value)
        yield
    finally:
        for parameter, value in _USUAL:
            library.mallopt(parameter, value)
        library.malloc_trim(0)


def _glibc() -> Any:
    try:
        library = ctypes.CDLL(None)
        return library if library.mallopt and library.malloc_trim else None
    except (AttributeError, OSError, TypeError):  # Windows has no library of all
        return None
