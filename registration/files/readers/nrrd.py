"""Read a scan volume from NRRD, data attached or in a file beside it, by pynrrd."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
    mapped,
    millimetres,
    scan_file_errors,
)

MAGIC = b"NRRD"

_SPACES = {
    **dict.fromkeys(("right-anterior-superior", "ras"), (LPS, (-1.0, -1.0, 1.0))),
    **dict.fromkeys(("left-anterior-superior", "las"), (LPS, (1.0, -1.0, 1.0))),
    **dict.fromkeys(("left-posterior-superior", "lps"), (LPS, (1.0, 1.0, 1.0))),
    "3d-right-handed": ("the file's", (1.0, 1.0, 1.0)),
    "3d-left-handed": ("the file's, x reversed", (-1.0, 1.0, 1.0)),
}
"""By NRRD's name: ours, and the signs that bring its x, y, z there."""

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
        header = nrrd.read_header(handle)
        return FileVolume(
            _volume(nrrd.read_data, handle, header, path),
            _known(header, path),
            _space(header, path),
        )


def _volume(read: Callable[..., Array], handle: Any, header: dict[str, Any], path: Path) -> Array:
    shape = tuple(int(size) for size in header["sizes"])
    if len(shape) != 3:
        raise ScanFileError(f"{path}: has {len(shape)} axes; export one grey volume")
    order = "<" if str(header.get("endian", "little")) == "little" else ">"
    kind = np.dtype(order + _KINDS.get(str(header["type"]), "V1"))
    if kind.kind == "V":
        raise ScanFileError(f"{path}: numbers of type {header['type']!r}; export real numbers")
    detached = header.get("data file", header.get("datafile"))
    data = path if detached is None else _beside(path, str(detached))
    encoding = str(header.get("encoding", "raw")).lower()
    start = handle.tell() if detached is None else 0
    size = data.stat().st_size - start
    ratio = DEFLATE_RATIO if encoding in _DEFLATED else 1 if encoding == "raw" else 100
    check_available(shape, kind, size * ratio, path)
    skips = int(header.get("byte skip", 0)) or int(header.get("line skip", 0))
    if encoding == "raw" and not skips:
        return mapped(data, kind, start, shape[::-1])
    if detached is not None:
        header = {**header, "data file": data.name}
    values = read(header, handle, str(path), index_order="C")
    if values.size != math.prod(shape):
        raise ScanFileError(f"{path}: holds {values.size} voxels, not {shape}; export it again")
    return np.asarray(values)


def _beside(path: Path, name: str) -> Path:
    """The detached data: one file, in the header's own folder."""
    place = (path.parent / name).resolve()
    if place.parent != path.parent.resolve() or not place.is_file():
        raise ScanFileError(f"{path}: its data file {name!r} isn't in its folder; put it there")
    return place


def _known(header: dict[str, Any], path: Path) -> dict[str, Any]:
    known: dict[str, Any] = {"axes": "zyx"}
    units = [str(unit) for unit in header.get("space units", header.get("units", ()))]
    units_mm = {millimetres(unit, path) for unit in units}
    if len(units_mm) != 1 or None in units_mm:
        return known  # NRRD has no unit of its own
    (unit,) = units_mm
    directions = header.get("space directions")
    sizes = header.get("spacings")
    if directions is not None:
        sizes = np.linalg.norm(np.asarray(directions, dtype=np.float64), axis=1)
    if sizes is not None and unit:
        known["voxel_mm"] = [float(size) * unit for size in sizes[::-1]]
    return known


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
    units = {millimetres(str(unit), path) or 1.0 for unit in header.get("space units", ("mm",))}
    return file_space(name, rows[::-1] * signs, origin * signs * max(units), path)
