"""Data files that a header names: one, a list of them, or a numbered pattern."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import DEFLATE_RATIO, Array, check_available, fill_volume

_PATTERN = re.compile(r"([^%]*%0?\d{0,2}[diu][^%\s]*)((?:\s+[-+]?\d+)*)")
"""A name with a number in it as C's printf has it; first and last number, step."""


def data_files(named: str, listed: Sequence[str], slices: int, path: Path) -> list[Path]:
    """Return the files that hold a header's data, in their order.

    NRRD and MetaImage spell them alike.

    Parameters
    ----------
    named : str
        As in the header: a name; ``LIST``; or a pattern with first, last and step.
    listed : sequence of str
        Lines that follow a ``LIST``.
    slices : int
        Of the volume, along its slowest axis: each file holds as many of them.
    path : Path
        Of the header.

    Raises
    ------
    ScanFileError
        When a file isn't in the header's folder or below, or slices don't divide among them.
    """
    pattern = _PATTERN.fullmatch(named)
    if named.split()[0] == "LIST":
        names = [line.strip() for line in listed if line.strip()]
        count = len(names)
    elif pattern:
        given = [int(number) for number in pattern[2].split()]
        first, last, step = (*given[:3], *(1, slices, 1)[len(given) :])
        numbers = range(first, last + (1 if step > 0 else -1), step)
        count = len(numbers)
        names = [pattern[1] % number for number in numbers[: slices + 1]]
    else:
        names, count = [named], 1
    if count == 0 or slices % count:
        raise ScanFileError(
            f"{path}: names {count} data files for {slices} slices, which don't divide evenly "
            "among them; mend the list or the numbers in the header"
        )
    return [beside(path, name) for name in names]


def beside(path: Path, name: str) -> Path:
    """Return a data file, which must lie in the header's folder or below."""
    folder, place = path.parent.resolve(), (path.parent / name).resolve()
    if not place.is_relative_to(folder) or not place.is_file():
        raise ScanFileError(f"{path}: its data file {name!r} isn't in its folder; put it there")
    return place


def stacked(
    files: Sequence[Path],
    read: Callable[[Path, tuple[int, ...]], Array],
    shape: tuple[int, ...],
    dtype: np.dtype[np.generic],
    path: Path,
) -> Array:
    """Return a volume (slowest axis first) whose files each hold an equal slab of it."""
    slab = (shape[0] // len(files), *shape[1:])
    if len(files) == 1:
        return read(files[0], slab)
    slabs = (read(file, slab) for file in files)
    return fill_volume(slabs, (len(files), *slab), dtype, path).reshape(shape)


def inflated(file: Path, start: int, shape: tuple[int, ...], kind: np.dtype[np.generic]) -> Array:
    """Return numbers that are compressed by zlib or gzip."""
    check_available(shape, kind, (file.stat().st_size - start) * DEFLATE_RATIO, file)
    size = int(np.prod(shape)) * kind.itemsize
    with file.open("rb") as handle:
        handle.seek(start)
        data = zlib.decompressobj(47).decompress(handle.read(), size)
    if len(data) < size:
        raise ScanFileError(f"{file}: holds {len(data)} of {size} bytes; copy or export it again")
    return np.frombuffer(bytearray(data), kind).reshape(shape)
