"""Read a scan volume from MetaImage (.mha, .mhd), as ITK and its programs write it.

By itk.org/Wiki/ITK/MetaIO/Documentation.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import ArrayLike

from registration.errors import ScanFileError
from registration.files.readers.common import (
    Array,
    FileVolume,
    check_available,
    mapped,
    scan_file_errors,
)
from registration.files.readers.volumes.detached import data_files, inflated, stacked

_START = re.compile(rb"\s*(Comment|ObjectType|ObjectSubType|NDims)\s*=[^\0]*")
_MOST_LINES = 1000
_KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "long": "i4", "ulong": "u4", "long_long": "i8", "ulong_long": "u8",
    "float": "f4", "double": "f8",
}  # fmt: skip
"""Without MET_; MetaIO's long has 4 bytes everywhere."""


def is_metaimage(start: bytes) -> bool:
    """Return whether a file begins as a MetaImage header does."""
    return _START.match(start) is not None and re.search(rb"\bNDims\s*=", start) is not None


def read_metaimage(path: Path) -> FileVolume:
    """Read the volume; its axes, fastest first, become x, y, z. The format has no unit of length.

    Raises
    ------
    ScanFileError
        When the file is broken or truncated, isn't one grey volume, or a data file is missing.
    """
    with scan_file_errors(path, "MetaImage"), path.open("rb") as handle:
        header, listed = _header(handle)
        shape = tuple(int(size) for size in header["dimsize"].split())
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        channels = header.get("elementnumberofchannels", "1")
        if len(shape) != 3 or channels != "1" or not _says(header, "binarydata", True):
            raise ScanFileError(
                f"{path}: has {len(shape)} axes and {channels} values a voxel, BinaryData = "
                f"{header.get('binarydata')}; write one grey volume of three axes, in binary"
            )
        name = header["elementtype"].removeprefix("MET_").lower()
        if name not in _KINDS:
            raise ScanFileError(f"{path}: numbers of type MET_{name.upper()} aren't read")
        high = _says(header, "elementbyteordermsb") or _says(header, "binarydatabyteordermsb")
        kind = np.dtype((">" if high else "<") + _KINDS[name])
        skip = int(header.get("headersize", "0"))
        zipped = _says(header, "compresseddata")
        local = header["elementdatafile"] == "LOCAL"

        def read(file: Path, slab: tuple[int, ...]) -> Array:
            start = handle.tell() if local else max(skip, 0)
            if zipped:
                return inflated(file, start, slab, kind)
            if skip == -1:  # the data are the file's end
                start = file.stat().st_size - int(np.prod(slab)) * kind.itemsize
            check_available(slab, kind, file.stat().st_size - max(start, 0), file)
            return mapped(file, kind, start, slab)

        files = [path] if local else data_files(header["elementdatafile"], listed, shape[2], path)
        volume = stacked(files, read, shape[::-1], kind, path)
        matrix = _numbers(header, ("transformmatrix", "rotation", "orientation"), np.eye(3))
        offset = _numbers(header, ("offset", "position", "origin"), np.zeros(3))
        rows = np.reshape(matrix, (round(len(matrix) ** 0.5), -1))[:3, :3]
        notes = [_spacing_note(_numbers(header, ("elementspacing", "elementsize"), ())[:3])]
        if any(offset) or not np.array_equal(rows, np.eye(3)):
            notes.append("its TransformMatrix and Offset aren't used, but for a mirror in them")
        known = {"axes": "zyx", "mirrored": bool(np.linalg.det(rows) < 0)}
        return FileVolume(volume, known, None, tuple(filter(None, notes)))


def _header(handle: IO[bytes]) -> tuple[dict[str, str], list[str]]:
    """Fields by their names in small letters, and the lines behind ``LIST``."""
    header: dict[str, str] = {}
    for _ in range(_MOST_LINES):
        name, _, value = handle.readline(1 << 16).decode("utf-8", "replace").partition("=")
        header[name.strip().lower()] = value.strip()
        if "elementdatafile" in header:
            break
    is_list = header["elementdatafile"].split()[0] == "LIST"
    return header, handle.read().decode().splitlines() if is_list else []


def _says(header: dict[str, str], name: str, default: bool = False) -> bool:
    return header.get(name, str(default))[:1].lower() in ("t", "1", "y")


def _numbers(header: dict[str, str], names: tuple[str, ...], default: ArrayLike) -> list[float]:
    found = next((header[name].split() for name in names if name in header), None)
    values = np.asarray(default if found is None else found, dtype=np.float64)
    return [float(value) for value in values.flat]


def _spacing_note(spacing: list[float]) -> str:
    """Say what the spacing means in ITK's convention."""
    if not spacing:
        return ""
    stated, as_mm = (",".join(f"{by * size:g}" for size in spacing) for by in (1, 1000))
    return f"its spacing is {stated} without a unit; if these are mm, as in ITK: --voxel-um {as_mm}"
