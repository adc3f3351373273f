"""Read a scan volume from a MATLAB ``.mat`` file of level 5; level 7.3 is HDF5.

Read by our own few lines, after MathWorks' public "MAT-File Format": SciPy's reader can crash the
interpreter on broken bytes. A file is a header of 128 bytes and elements of ``uint32 type, uint32
size, bytes``; a variable is an element of type 14 (or 15: the same, deflated) that holds flags,
dimensions, name and numbers, each an element padded to 8 bytes. Level 4, cells and structures are
not read.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.broken_files import scan_file_errors
from registration.files.readers.limits import DEFLATE_RATIO, bytes_of
from registration.files.readers.metadata import NAMES
from registration.files.readers.raw_result import Array, FileVolume

MAGIC = b"MATLAB 5.0 MAT-file"

_HEADER_BYTES, _START_BYTES = 128, 4096
_MATRIX, _DEFLATED = 14, 15
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
           13: "u8", 16: "u1", 17: "u2"}  # fmt: skip
_CLASSES = {4: "U", 6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4",
            14: "i8", 15: "u8"}  # fmt: skip
_TEXT = "U"
_COMPLEX = 0x0800


@dataclass(frozen=True)
class _Variable:
    """A variable as its first bytes describe it; ``numbers`` is where those begin, inflated."""

    name: str
    kind: str
    shape: tuple[int, ...]
    begin: int
    end: int
    deflated: bool
    numbers: int


def read_matlab(path: Path) -> FileVolume:
    """The one variable of three axes, with what variables beside it say by a sidecar's keys.

    ``axes`` names the array's axes as NumPy indexes them, which is MATLAB's own order of
    subscripts: ``V(z, y, x)`` is "zyx".

    Raises
    ------
    ScanFileError
        When the file is broken, or holds no volume, or several of which none is named "volume".
    """
    with scan_file_errors(path, "MATLAB file"):
        data = np.memmap(path, np.uint8, "c")
        order = {b"IM": "<", b"MI": ">"}.get(bytes(data[126:128]))
        if order is None:
            raise ScanFileError(f"{path}: broken MATLAB file (no byte order); save it again")
        variables = {item.name: item for item in _variables(data, order)}
        volumes = [v for v in variables.values() if len(v.shape) == 3 and v.kind != _TEXT]
        named = [v for v in volumes if v.name == "volume"] or volumes
        if len(named) != 1:
            raise ScanFileError(
                f"{path}: holds {len(volumes)} arrays of three axes "
                f"({', '.join(v.name for v in volumes)}); name the scan 'volume' or leave one"
            )
        known = {
            name: _plain(_values(data, variables[name], order, path), variables[name].kind)
            for name in NAMES
            if name in variables and math.prod(variables[name].shape) <= 64
        }
        return FileVolume(_values(data, named[0], order, path), known)


def _variables(data: Array, order: str) -> Iterator[_Variable]:
    """Every numeric or text variable of a file."""
    at = _HEADER_BYTES
    while at + 8 <= len(data):
        kind, size = struct.unpack(order + "II", bytes(data[at : at + 8]))
        begin, end = at + 8, at + 8 + size
        if end > len(data):
            raise ValueError(f"an element of {size} bytes at {at} goes beyond the end")
        if kind in (_MATRIX, _DEFLATED):
            start = bytes(data[begin : min(end, begin + _START_BYTES)])
            if kind == _DEFLATED:
                start = zlib.decompressobj().decompress(start, _START_BYTES)[8:]
            variable = _described(start, order, begin, end, kind == _DEFLATED)
            if variable is not None:
                yield variable
        # Deflated elements alone aren't padded.
        at = end if kind == _DEFLATED else end + -size % 8


def _described(start: bytes, order: str, begin: int, end: int, deflated: bool) -> _Variable | None:
    _, flags, at = _element(start, 0, order)
    (word,) = struct.unpack_from(order + "I", flags)
    kind = _CLASSES.get(word & 0xFF)
    if kind is None or word & _COMPLEX:
        return None
    _, sizes, at = _element(start, at, order)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes[: len(sizes) // 4 * 4])
    _, name, at = _element(start, at, order)
    return _Variable(name.decode("ascii"), kind, shape, begin, end, deflated, at)


def _element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Type and bytes of a small element, and where the next begins."""
    kind, size = struct.unpack_from(order + "II", data, at)
    if kind >> 16:
        return kind & 0xFFFF, data[at + 4 : at + 4 + (kind >> 16)], at + 8
    if at + 8 + size > len(data):
        raise ValueError(f"an element of {size} bytes is longer than its variable")
    return kind, data[at + 8 : at + 8 + size], at + 8 + size + -size % 8


def _values(data: Array, item: _Variable, order: str, path: Path) -> Array:
    """A variable's numbers (text as codes): a view where they lie plain, of the class's type."""
    plain: Array = data[item.begin : item.end]
    if item.deflated:
        plain = _inflated(bytes(plain), order, path)
    tag, size = struct.unpack(order + "II", bytes(plain[item.numbers : item.numbers + 8]))
    begin = item.numbers + 8
    if tag >> 16:
        tag, size, begin = tag & 0xFFFF, tag >> 16, item.numbers + 4
    stored = np.dtype(order + _STORED[tag])
    # Whole numbers of a large type may be stored in a smaller one: so the bytes are counted.
    if bytes_of(item.shape, stored, path) != size or begin + size > len(plain):
        raise ScanFileError(
            f"{path}: {item.name} of {item.shape} holds {size} bytes as {stored}; it is truncated "
            "or its sizes are wrong: save it again"
        )
    values = plain[begin : begin + size].view(stored).reshape(item.shape, order="F")
    if item.kind == _TEXT or np.dtype(item.kind) == stored.newbyteorder("="):
        return values
    return values.astype(item.kind)


def _inflated(data: bytes, order: str, path: Path) -> Array:
    """What a deflated element holds, no more than it says."""
    stream = zlib.decompressobj()
    head = stream.decompress(data, 8)
    _, size = struct.unpack(order + "II", head)
    if size > len(data) * DEFLATE_RATIO:
        raise ScanFileError(f"{path}: {len(data)} bytes can't hold {size}; save it again")
    plain = stream.decompress(stream.unconsumed_tail, size + 1)
    if len(plain) != size:
        raise ScanFileError(f"{path}: an element holds {len(plain)} bytes, not {size}; truncated")
    return np.frombuffer(plain, np.uint8)


def _plain(value: Array, kind: str) -> Any:
    flat = value.ravel().tolist()
    if kind == _TEXT:
        return "".join(map(chr, flat))
    return flat[0] if len(flat) == 1 else flat
