"""Write a scan as OME-Zarr (NGFF 0.4 on Zarr 2) without a library: one level, zlib chunks."""

from __future__ import annotations

import itertools
import json
import math
import os
import shutil
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from design.files import write_bytes
from registration.errors import RegistrationError
from registration.files.readers.metadata import SCHEMA, metadata_of
from registration.files.readers.zarr import is_zarr
from registration.scan import Scan

_CHUNK = 64
_LEVEL = 1
"""Speckle hardly compresses; more effort would only cost time."""


def write_scan_zarr(path: Path, scan: Scan) -> None:
    """Write a folder that `read_scan` reads back exactly; an old one is replaced at the end.

    Raises
    ------
    RegistrationError
        When something that isn't OME-Zarr stands at `path`.
    OSError
        When the disk is full or the folder can't be written.
    """
    if path.exists() and not is_zarr(path):
        raise RegistrationError(f"{path}: exists and isn't OME-Zarr; remove it or choose a name")
    draft, old = (path.with_name(f".{path.name}.{os.getpid()}.{end}") for end in ("part", "old"))
    try:
        _write(draft, scan, path.name.split(".")[0])
        if path.exists():
            path.replace(old)
        draft.replace(path)
    finally:
        for rest in (draft, old):
            shutil.rmtree(rest, ignore_errors=True)


def _write(folder: Path, scan: Scan, name: str) -> None:
    kind = scan.volume.dtype.newbyteorder("<")
    chunk = [min(_CHUNK, size) for size in scan.volume.shape]
    _json(folder / ".zgroup", {"zarr_format": 2})
    _json(folder / ".zattrs", _attributes(scan, name))
    array = {
        "zarr_format": 2, "shape": list(scan.volume.shape), "chunks": chunk, "dtype": kind.str,
        "compressor": {"id": "zlib", "level": _LEVEL}, "fill_value": 0, "order": "C",
        "filters": None, "dimension_separator": "/",
    }  # fmt: skip
    _json(folder / "0" / ".zarray", array)
    counts = [math.ceil(n / c) for n, c in zip(scan.volume.shape, chunk, strict=True)]
    for index in itertools.product(*map(range, counts)):
        where = tuple(slice(i * c, (i + 1) * c) for i, c in zip(index, chunk, strict=True))
        part = scan.volume[where]
        whole = np.zeros(chunk, kind)  # chunks at the edge are stored whole
        whole[tuple(slice(0, size) for size in part.shape)] = part
        place = folder / "0" / str(index[0]) / str(index[1]) / str(index[2])
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(zlib.compress(whole.tobytes(), _LEVEL))


def _attributes(scan: Scan, name: str) -> dict[str, Any]:
    axes = [{"name": name, "type": "space", "unit": "millimeter"} for name in "zyx"]
    scale = {"type": "scale", "scale": list(scan.geometric_voxel_mm)}
    image = {
        "version": "0.4",
        "name": name,
        "axes": axes,
        "datasets": [{"path": "0", "coordinateTransformations": [scale]}],
    }
    return {"multiscales": [image], "printctl": {"schema": SCHEMA, **metadata_of(scan)}}


def _json(path: Path, value: Any) -> None:
    write_bytes(path, json.dumps(value, indent=1, allow_nan=False).encode())
