"""Decompress Zarr chunks: zlib and gzip by Python itself, blosc, zstd and lz4 by numcodecs."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

from registration.errors import ScanFileError
from registration.files.readers.extras import import_extra

_BY_NUMCODECS = ("blosc", "zstd", "lz4")


def decode(data: bytes, codec: dict[str, Any] | None, expected: int, path: Path) -> bytes:
    """The plain bytes of a chunk, never more than it may hold.

    Parameters
    ----------
    data : bytes
        The chunk as stored.
    codec : dict or None
        Its compressor, by ``id``; None where it isn't compressed.
    expected : int
        Bytes that a whole chunk takes.
    path : Path
        For the message.

    Raises
    ------
    ScanFileError
        When the codec isn't known, or the bytes are broken or not of that number.
    """
    plain = _decode(data, codec, expected, path)
    if len(plain) != expected:
        raise ScanFileError(
            f"{path}: a chunk holds {len(plain)} bytes, not {expected}; it is truncated or its "
            "sizes are wrong: copy it again"
        )
    return plain


def _decode(data: bytes, codec: dict[str, Any] | None, expected: int, path: Path) -> bytes:
    if codec is None:
        return data
    name = str(codec.get("id"))
    if name in ("zlib", "gzip"):
        # 47: a zlib or a gzip header, whichever comes.
        stream = zlib.decompressobj(47)
        try:
            return stream.decompress(data, expected + 1)
        except zlib.error as exc:
            raise ScanFileError(f"{path}: a broken chunk ({exc}); copy it again") from exc
    if name in _BY_NUMCODECS:
        registry = import_extra("numcodecs", path)
        if name == "blosc" and _blosc_size(data) != expected:
            return b""
        try:
            return bytes(registry.get_codec({"id": name}).decode(data))
        except (RuntimeError, ValueError) as exc:
            raise ScanFileError(f"{path}: a broken chunk ({exc}); copy it again") from exc
    raise ScanFileError(
        f"{path}: chunks are compressed by {name!r}; known are zlib, gzip, "
        f"{', '.join(_BY_NUMCODECS)}: export it with one of them"
    )


def _blosc_size(data: bytes) -> int:
    """Plain size from a blosc header (bytes 4 to 8), before anything is allocated."""
    return int.from_bytes(data[4:8], "little")
