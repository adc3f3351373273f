"""Refuse an uploaded scan file that would unpack too large: zip, gzip, NIfTI, gzipped NRRD.

What a gzip stream gives is counted as it comes out; of a zip its own sizes count, which Python's
reader never exceeds.
"""

from __future__ import annotations

import contextlib
import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from printctl.web.errors import BadRequestError

_PIECE: Final = 1 << 16
_OUT: Final = 1 << 20
_RATIO: Final = 200
"""Most bytes out for a byte in, from `_RATIO_FROM` bytes out."""
_RATIO_FROM: Final = 200_000_000
"""A mask of few voxels packs a thousandfold, and may be so large."""
_GZIP: Final = b"\x1f\x8b"
_NRRD: Final = b"NRRD"
_LONGEST_HEAD: Final = 1 << 20


def check_growth(total: int, packed: int, most_bytes: int) -> None:
    """Refuse an archive that has given ``total`` bytes out of ``packed``, if that is too much.

    Raises
    ------
    BadRequestError
    """
    if total > most_bytes:
        raise BadRequestError(
            f"the archive unpacks to more than {total / 1e6:.0f} MB; at most "
            f"{most_bytes / 1e6:g} MB are taken"
        )
    if total > _RATIO_FROM and total > _RATIO * packed:
        raise BadRequestError(
            f"the archive unpacks to more than {_RATIO} times its size; pack it anew "
            "without emptiness, or send the files alone"
        )


def refuse_growth(path: Path, most_bytes: int) -> None:
    """Refuse a file that unpacks to more than may be, or grows too much in doing so.

    Raises
    ------
    BadRequestError
    """
    packed = path.stat().st_size
    if zipfile.is_zipfile(path):
        with contextlib.suppress(zipfile.BadZipFile, NotImplementedError):  # the reader's to tell
            with zipfile.ZipFile(path) as archive:
                total = sum(one.file_size for one in archive.infolist())
            check_growth(total, packed, most_bytes)
        return
    with path.open("rb") as handle:
        if _at_gzip(handle):
            _count(handle, packed, most_bytes)


def _at_gzip(handle: BinaryIO) -> bool:
    """Go to where a gzip stream begins in the file, if one does."""
    head = handle.read(_LONGEST_HEAD)
    start = 0 if head.startswith(_GZIP) else -1
    if head.startswith(_NRRD):
        ends = [end for mark in (b"\n\n", b"\r\n\r\n") if (end := head.find(mark) + len(mark)) >= 4]
        start = next((end for end in sorted(ends) if head[end : end + 2] == _GZIP), -1)
    if start >= 0:
        handle.seek(start)
    return start >= 0


def _count(handle: BinaryIO, packed: int, most_bytes: int) -> None:
    """Count what comes out; several streams may follow each other. Broken ones are the reader's."""
    total, stream = 0, zlib.decompressobj(31)
    data = handle.read(_PIECE)
    try:
        while data:
            total += len(stream.decompress(data, _OUT))
            check_growth(total, packed, most_bytes)
            data = stream.unconsumed_tail
            if stream.eof:
                data, stream = stream.unused_data, zlib.decompressobj(31)
            data = data or handle.read(_PIECE)
    except zlib.error:
        return
