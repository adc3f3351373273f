"""Tune glibc's memory allocation: reuse freed memory of large arrays, or return it at once."""

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
def keep_freed_memory() -> Iterator[None]:
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


@contextmanager
def freed_memory_returned() -> Iterator[None]:
    """Have arrays above 1 MB mapped by themselves, so that each is given back when it is freed.

    Glibc raises that limit to the largest array that was freed, and what lies between smaller ones
    stays with the process. For work that handles a large input once and goes on with small arrays.
    """
    library = _glibc()
    if library is not None:
        library.mallopt(_MMAP_THRESHOLD, 1 << 20)
    try:
        yield
    finally:
        if library is not None:
            for parameter, value in _USUAL:
                library.mallopt(parameter, value)


def _glibc() -> Any:
    try:
        library = ctypes.CDLL(None)
        return library if library.mallopt and library.malloc_trim else None
    except (AttributeError, OSError, TypeError):  # Windows has no library of all
        return None
