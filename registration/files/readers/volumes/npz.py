"""Read a scan from a NumPy archive: an array ``volume`` and scalar metadata."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from registration.errors import ScanFileError
from registration.files.readers.common import (
    Array,
    FileVolume,
    available_bytes,
    check_available,
    empty,
    read_into,
    scan_file_errors,
)
from registration.files.readers.metadata import NAMES


def read_npz(path: Path) -> FileVolume:
    """Volume (axes z, y, x unless ``axes`` says otherwise) and the metadata in an archive.

    Raises
    ------
    ScanFileError
        When the archive is broken or has no ``volume``.
    """
    with scan_file_errors(path, "archive"), zipfile.ZipFile(path) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        if "volume" not in members:
            raise ScanFileError(f"{path}: has no array 'volume' (it has: {', '.join(members)})")
        known = {name: _scalar(archive, members[name]) for name in NAMES if name in members}
        return FileVolume(_volume(archive, members["volume"], path), {"axes": "zyx", **known})


def _scalar(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Any:
    if info.file_size > 4096:
        raise ValueError(f"{info.filename} holds {info.file_size} bytes, not a few numbers")
    with archive.open(info) as handle:
        return npy.read_array(handle, allow_pickle=False).tolist()


def _volume(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path) -> Array:
    with archive.open(info) as handle:
        version = npy.read_magic(handle)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, by_columns, dtype = read(handle)
        if dtype.hasobject:
            raise ValueError("'volume' holds Python objects, not numbers")
        check_available(shape, dtype, available_bytes(info), path)
        out = empty(shape[::-1] if by_columns else shape, dtype, path)
        read_into(handle, out)
    return np.asarray(out.T if by_columns else out)
