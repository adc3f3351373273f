"""Release the memory pages of mapped files after use."""

from __future__ import annotations

import mmap

import numpy as np
from numpy.typing import NDArray


def drop_pages(volume: NDArray[np.generic]) -> None:
    """Give back what of a file was read: else a copy of it would cost its memory twice."""
    pages = getattr(volume, "_mmap", None)
    if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)
