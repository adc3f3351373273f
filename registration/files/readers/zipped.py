"""Read members of zip archives in place; nothing is extracted to a path."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from registration.files.readers.limits import DEFLATE_RATIO, check_available
from registration.files.readers.raw_result import Array
from registration.files.readers.storage import empty, mapped

_PIECE = 16 << 20
_LOCAL_HEADER = 30


def available_bytes(info: zipfile.ZipInfo) -> int:
    """Bytes that a member can really give, whatever its header claims."""
    if info.compress_type == zipfile.ZIP_STORED:
        return min(info.file_size, info.compress_size)
    return min(info.file_size, info.compress_size * DEFLATE_RATIO)


def read_into(handle: IO[bytes], out: Array) -> None:
    """Fill a contiguous array from a stream, piece by piece.

    Raises
    ------
    EOFError
        When the stream ends early.
    """
    room = memoryview(out.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
    done = 0
    while done < len(room):
        piece = handle.read(min(_PIECE, len(room) - done))
        if not piece:
            raise EOFError(f"ends after {done} of {len(room)} bytes")
        room[done : done + len(piece)] = piece
        done += len(piece)


def member_array(
    archive: zipfile.ZipFile,
    info: zipfile.ZipInfo,
    dtype: np.dtype[np.generic],
    shape: tuple[int, ...],
    path: Path,
) -> Array:
    """An array that is a member's whole content: a view of the file where it lies uncompressed.

    Raises
    ------
    ScanFileError
        When the member is too short for it.
    """
    check_available(shape, dtype, available_bytes(info), path)
    if info.compress_type == zipfile.ZIP_STORED and not info.flag_bits & 0x1:
        return mapped(path, dtype, _data_offset(path, info), shape)
    out = empty(shape, dtype, path)
    with archive.open(info) as handle:
        read_into(handle, out)
    return out


def _data_offset(path: Path, info: zipfile.ZipInfo) -> int:
    """Where a member's bytes begin (its local header's names may differ in length)."""
    with path.open("rb") as handle:
        handle.seek(info.header_offset)
        local = handle.read(_LOCAL_HEADER)
    if len(local) < _LOCAL_HEADER or local[:4] != b"PK\x03\x04":
        raise zipfile.BadZipFile(f"no member begins at byte {info.header_offset}")
    name, extra = struct.unpack("<HH", local[26:30])
    return info.header_offset + _LOCAL_HEADER + name + extra
