"""Read Bioptigen (Leica Envisu) ``.OCT``: keyed records, then frames of 16-bit A-scans.

Layout, little endian: two bytes twice (a magic number), two bytes of version, then records of
``uint32 length, key, uint32 length, value`` from ``FRAMEHEADER`` to a length of 0; then
``FRAMECOUNT`` frames, each the records ``FRAMEDATA`` (empty, a container) to ``FRAMESAMPLES``
(uint16, depth fastest, then x), ended by a length of 0. Sources: marksgraham/OCT-Converter
(``binary_structs/boct_binary.py``), and readers after Bioptigen's ``extractOctFunction.m``
(B. Bower), which name the keys and their types.

Not verified on a device's file: that AZSCANLENGTH (x), ELSCANLENGTH (y) and SCANDEPTH (depth)
are mm. Whether depth is optical and whether intensity is linear the file doesn't say: asked for.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import Array, FileVolume, check_available, fill_volume

_MARK = b"FRAMEHEADER"
_FIRST_RECORD = 6
_MOST_RECORDS = 64
_NOTE = "Bioptigen: scan lengths are taken as mm (not verified on a device's file)"
_RECTANGULAR = 1


def is_bioptigen(start: bytes) -> bool:
    """Whether a file's first bytes are those of a Bioptigen volume."""
    return start[_FIRST_RECORD + 4 : _FIRST_RECORD + 4 + len(_MARK)] == _MARK


def read_bioptigen(path: Path) -> FileVolume:
    """The volume of a rectangular scan.

    Raises
    ------
    ScanFileError
        When the file is truncated, its sizes are wrong, or it isn't a rectangular scan.
    """
    data = np.memmap(path, np.uint8, "r")
    try:
        header, at = _records(data, _FIRST_RECORD)
        return _read(data, header, at, path)
    except (struct.error, IndexError, KeyError, UnicodeDecodeError) as exc:
        raise ScanFileError(f"{path}: broken Bioptigen file ({exc!r}); copy it again") from exc


def _read(data: Array, header: dict[str, bytes], at: int, path: Path) -> FileVolume:
    frames, lines, depth = (
        _whole(header[name]) for name in ("FRAMECOUNT", "LINECOUNT", "LINELENGTH")
    )
    if _whole(header.get("SCANTYPE", b"\1")) != _RECTANGULAR or frames < 2:
        raise ScanFileError(f"{path}: not a rectangular volume scan; scan a rectangle")
    repeats = _whole(header.get("FRAMES", b"\0")) or frames
    scans = _whole(header.get("SCANS", b"\1"))
    if repeats * scans != frames or scans > 1:
        raise ScanFileError(
            f"{path}: {frames} frames in {scans} scans of {repeats}; export one volume"
        )
    shape, kind = (frames, lines, depth), np.dtype("<u2")
    check_available(shape, kind, len(data) - at, path)
    places = _frames(data, at, frames, lines * depth * 2, path)
    views = (data[p : p + lines * depth * 2].view(kind).reshape(lines, depth) for p in places)
    known: dict[str, object] = {"axes": "yxz", "modality": "oct", "depth_down": True}
    lengths = [_real(header[n]) for n in ("SCANDEPTH", "ELSCANLENGTH", "AZSCANLENGTH")]
    known["voxel_mm"] = [s / n for s, n in zip(lengths, (depth, frames, lines), strict=True)]
    return FileVolume(fill_volume(views, shape, kind, path), known, notes=(_NOTE,))


def _frames(data: Array, at: int, count: int, size: int, path: Path) -> list[int]:
    """Where each frame's samples begin."""
    places = []
    for index in range(count):
        records, after = _records(data, at)
        if len(records["FRAMESAMPLES"]) != 16:
            raise KeyError("FRAMESAMPLES")
        begin, length = struct.unpack("<QQ", records["FRAMESAMPLES"])
        if length != size or begin + length > len(data):
            raise ScanFileError(
                f"{path}: frame {index} holds {length} bytes, not {size}; it is truncated or its "
                "sizes are wrong: copy it again"
            )
        places.append(begin)
        at = after
    return places


def _records(data: Array, at: int) -> tuple[dict[str, bytes], int]:
    """Records from a place to the length of 0 that ends them, and where that ends.

    Of ``FRAMESAMPLES`` the value is where its bytes begin and how many they are.
    """
    records: dict[str, bytes] = {}
    for _ in range(_MOST_RECORDS):
        length = _word(data, at)
        at += 4
        if length == 0:
            return records, at
        if length > 64:
            raise IndexError(f"a key of {length} bytes at {at}")
        key = bytes(data[at : at + length]).decode("ascii")
        size = _word(data, at + length)
        at += length + 4
        if key in ("FRAMEHEADER", "FRAMEDATA"):
            continue
        if key == "FRAMESAMPLES":
            records[key] = struct.pack("<QQ", at, size)
        else:
            records[key] = bytes(data[at : at + min(size, 4096)])
        at += size
    raise IndexError(f"more than {_MOST_RECORDS} records")


def _word(data: Array, at: int) -> int:
    (value,) = struct.unpack("<I", bytes(data[at : at + 4]))
    return int(value)


def _whole(value: bytes) -> int:
    return int.from_bytes(value[:4], "little")


def _real(value: bytes) -> float:
    (number,) = struct.unpack("<d", value[:8])
    return float(number)
