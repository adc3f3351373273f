"""Refuse scan sizes in a header that the file can't hold, before memory is allocated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from registration.errors import ScanFileError

MOST_BYTES = 1 << 40
"""No scan holds more: 1 TiB."""

DEFLATE_RATIO = 1032
"""Deflate can't expand a byte to more (RFC 1951: a match of 258 bytes takes at least 2 bits)."""

ANY_RATIO = 8 * DEFLATE_RATIO
"""Other compressions have no such bound, but no scan that shows anything shrinks by more."""

IN_MEMORY_BYTES = 64 << 20
"""A volume up to this is read into memory; a larger one stays a view of a file."""


def bytes_of(shape: Sequence[int], dtype: np.dtype[np.generic], path: Path) -> int:
    """Bytes that an array of this shape takes.

    Raises
    ------
    ScanFileError
        When a size isn't positive, or the whole is beyond any scan.
    """
    if any(size < 1 for size in shape):
        raise ScanFileError(f"{path}: its header says {_times(shape)} voxels; export it again")
    total = math.prod(int(size) for size in shape) * dtype.itemsize
    if total > MOST_BYTES:
        raise ScanFileError(
            f"{path}: its header says {_times(shape)} voxels of {dtype}, {total:.3g} bytes; no "
            f"scan is larger than {MOST_BYTES:.3g}: the header is broken, export it again"
        )
    return total


def check_available(
    shape: Sequence[int], dtype: np.dtype[np.generic], available: int, path: Path
) -> None:
    """Refuse an array that its file can't hold.

    Parameters
    ----------
    shape, dtype
        As the header says.
    available : int
        Bytes that the file can give for it.
    path : Path
        For the message.

    Raises
    ------
    ScanFileError
        When the header promises more than there is.
    """
    needed = bytes_of(shape, dtype, path)
    if needed > available:
        raise ScanFileError(
            f"{path}: its header says {_times(shape)} voxels of {dtype}, {needed} bytes, but the "
            f"file holds at most {available}; it is truncated or its sizes are wrong: copy or "
            "export it again"
        )


def _times(shape: Sequence[int]) -> str:
    return " × ".join(str(size) for size in shape)
