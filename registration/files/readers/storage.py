"""Arrays for scan voxels: a view of the scan file, memory, or a temporary file if too large."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from registration.files.readers.limits import IN_MEMORY_BYTES, bytes_of, check_available
from registration.files.readers.raw_result import Array
from registration.memory_pages import drop_pages

_COPY_BYTES = 1 << 20
"""Turned at a time where axes change places: what a core's cache holds."""

_DROP_BYTES = 64 << 20


def mapped(path: Path, dtype: np.dtype[np.generic], offset: int, shape: Sequence[int]) -> Array:
    """A view of an array in a file, in C order; writes go to memory and never to the file.

    Raises
    ------
    ScanFileError
        When the file is shorter than the array.
    """
    check_available(shape, dtype, path.stat().st_size - offset, path)
    return np.memmap(path, dtype, "c", offset, tuple(shape))


def empty(shape: Sequence[int], dtype: np.dtype[np.generic], path: Path) -> Array:
    """Room for a volume that is decoded: memory, or a nameless temporary file when it is large.

    Raises
    ------
    ScanFileError
        When the size is beyond any scan.
    OSError
        When the disk has no room for it.
    """
    total = bytes_of(shape, dtype, path)
    if total <= IN_MEMORY_BYTES:
        return np.empty(tuple(shape), dtype)
    with tempfile.TemporaryFile() as room:
        room.truncate(total)
        return np.memmap(room, dtype, "r+", 0, tuple(shape))


def fill_volume(
    slices: Iterable[Array], shape: Sequence[int], dtype: np.dtype[np.generic], path: Path
) -> Array:
    """A volume from its slices along the first axis, in order."""
    out = empty(shape, dtype, path)
    for index, part in enumerate(slices):
        out[index] = part
    return out


def native(volume: Array) -> Array:
    """Contiguous, in the machine's byte order, and no float16: what the kernels take.

    A volume too large for memory stays the view it is, unless its numbers need turning; `slabs`
    of the scan then make the parts contiguous.
    """
    kind = np.dtype(np.float32) if volume.dtype == np.float16 else volume.dtype.newbyteorder("=")
    if volume.nbytes > IN_MEMORY_BYTES and volume.dtype != np.float16:
        return volume
    if volume.flags.c_contiguous and volume.dtype == kind and not _is_mapped(volume):
        return volume
    out = np.empty(volume.shape, kind)
    axis = int(np.argmax(np.abs(volume.strides)))
    count = max(1, _COPY_BYTES * volume.shape[axis] // max(1, volume.nbytes))
    for first in range(0, volume.shape[axis], count):
        part = [slice(None)] * 3
        part[axis] = slice(first, first + count)
        out[tuple(part)] = volume[tuple(part)]
        if first // count % max(1, _DROP_BYTES // _COPY_BYTES) == 0:
            drop_pages(volume)
    drop_pages(volume)
    return out


def _is_mapped(volume: Array) -> bool:
    return isinstance(volume, np.memmap)
