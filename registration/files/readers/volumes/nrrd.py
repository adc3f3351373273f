"""Read a scan volume from NRRD, data attached or in files beside it, by pynrrd."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import (
    DEFLATE_RATIO,
    LPS,
    Array,
    FileSpace,
    FileVolume,
    check_available,
    file_space,
    known_voxel,
    mapped,
    millimetres,
    scan_file_errors,
)
from registration.files.readers.volumes.detached import data_files, stacked

MAGIC = b"NRRD"

_SPACES = {
    **dict.fromkeys(("right-anterior-superior", "ras"), (LPS, (-1.0, -1.0, 1.0))),
    **dict.fromkeys(("left-anterior-superior", "las"), (LPS, (1.0, -1.0, 1.0))),
    **dict.fromkeys(("left-posterior-superior", "lps"), (LPS, (1.0, 1.0, 1.0))),
    "3d-right-handed": ("the file's", (1.0, 1.0, 1.0)),
    "3d-left-handed": ("the file's, x reversed", (-1.0, 1.0, 1.0)),
}
"""By NRRD's name: ours, and the signs that bring its x, y, z there."""

_LIST = re.compile(r"data ?file:\s*LIST\b")
_DEFLATED = ("gzip", "gz")
_KINDS = {
    "signed char": "i1", "int8": "i1", "int8_t": "i1", "uchar": "u1", "unsigned char": "u1",
    "uint8": "u1", "uint8_t": "u1", "short": "i2", "short int": "i2", "int16": "i2",
    "int16_t": "i2", "ushort": "u2", "unsigned short": "u2", "uint16": "u2", "uint16_t": "u2",
    "int": "i4", "int32": "i4", "int32_t": "i4", "uint": "u4", "unsigned int": "u4",
    "uint32": "u4", "uint32_t": "u4", "float": "f4", "double": "f8",
}  # fmt: skip


def read_nrrd(path: Path) -> FileVolume:
    """The volume; its axes, fastest first, become x, y, z.

    Raises
    ------
    ScanFileError
        When the file is broken or truncated, isn't of three axes, or names data elsewhere.
    """
    import nrrd  # only where such a file comes

    with scan_file_errors(path, "NRRD"), path.open("rb") as handle:
        lines, listed = _header_lines(handle)
        header = nrrd.read_header(lines)
        known, notes = _known(header)
        volume = _volume(nrrd.read_data, handle, header, listed, path)
        return FileVolume(volume, known, _space(header, path), notes)


def _header_lines(handle: IO[bytes]) -> tuple[list[str], list[str]]:
    """Return the header's lines and, behind ``data file: LIST``, the names; pynrrd drops any µ."""
    lines: list[str] = []
    for line in handle:
        lines.append(_text(line))
        if not lines[-1].rstrip():
            break
        if _LIST.match(lines[-1]):
            return lines, [_text(name) for name in handle]
    return lines, []


def _text(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _volume(
    read: Callable[..., Array],
    handle: IO[bytes],
    header: dict[str, Any],
    listed: list[str],
    path: Path,
) -> Array:
    shape = tuple(int(size) for size in header["sizes"])
    if len(shape) != 3:
        raise ScanFileError(f"{path}: has {len(shape)} axes; export one grey volume")
    order = "<" if str(header.get("endian", "little")) == "little" else ">"
    kind = np.dtype(order + _KINDS.get(str(header["type"]), "V1"))
    if kind.kind == "V":
        raise ScanFileError(f"{path}: numbers of type {header['type']!r}; export real numbers")
    detached = header.get("data file", header.get("datafile"))
    files = [path]
    if detached is not None:
        files = data_files(str(detached), listed, shape[2], path)
    encoding = str(header.get("encoding", "raw")).lower()
    ratio = DEFLATE_RATIO if encoding in _DEFLATED else 1 if encoding == "raw" else 100
    skips = any(
        int(header.get(f"{what}{gap}skip", 0)) for what in ("byte", "line") for gap in (" ", "")
    )
    begin = handle.tell()

    def read_slab(file: Path, slab: tuple[int, ...]) -> Array:
        start = begin if detached is None else 0
        check_available(slab, kind, (file.stat().st_size - start) * ratio, path)
        if encoding == "raw" and not skips:
            return mapped(file, kind, start, slab)
        elsewhere = {} if detached is None else {"datafile": str(file)}
        one = {**header, "sizes": np.array(slab[::-1]), **elsewhere}
        values = read(one, handle, str(path), index_order="C")
        if values.size != math.prod(slab):
            raise ScanFileError(f"{file}: holds {values.size} voxels, not {slab}; export it again")
        return np.asarray(values)

    return stacked(files, read_slab, shape[::-1], kind, path)


def _known(header: dict[str, Any]) -> tuple[dict[str, object], tuple[str, ...]]:
    """Return order and sizes of the axes, and notes; NRRD has no unit of its own."""
    units = [str(unit) for unit in header.get("space units", header.get("units", ()))]
    directions, sizes = header.get("space directions"), header.get("spacings")
    if directions is not None:
        sizes = np.linalg.norm(np.asarray(directions, dtype=np.float64), axis=1)
    if sizes is None or not units:
        return {"axes": "zyx"}, ()
    if directions is not None and len({millimetres(unit) for unit in units}) > 1:
        return {"axes": "zyx"}, ("its axes of space have several units",)
    known, notes = known_voxel(sizes[::-1], units[::-1])
    return {"axes": "zyx", **known}, notes


def _space(header: dict[str, Any], path: Path) -> FileSpace | None:
    """From the space directions (rows, fastest axis first); None where the space has no name."""
    directions, space = header.get("space directions"), str(header.get("space", "")).lower()
    if directions is None or space not in _SPACES:
        return None
    rows = np.asarray(directions, dtype=np.float64)
    if rows.shape != (3, 3):
        raise ScanFileError(f"{path}: its space directions are {directions}; give three of three")
    name, signs = _SPACES[space]
    origin = np.asarray(header.get("space origin", (0.0, 0.0, 0.0)), dtype=np.float64)
    units = {millimetres(str(unit)) or 1.0 for unit in header.get("space units", ("mm",))}
    return file_space(name, rows[::-1] * signs, origin * signs * max(units), path)
