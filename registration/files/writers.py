"""Write a scan to a file: Thorlabs ``.oct``, OME-Zarr or TIFF.

Goes in: a `Scan`. Comes out: a file.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import shutil
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import NDArray

from design.files import atomic_replacement, write_bytes
from registration.errors import RegistrationError
from registration.files.readers.metadata import SCHEMA, describe, metadata_of
from registration.files.readers.vendors.thorlabs import OURS
from registration.files.readers.volumes.tiff import write_scan_tiff
from registration.files.readers.volumes.zarr import is_zarr
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


def _attributes(scan: Scan, name: str) -> dict[str, object]:
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


# Intensity is float32 in dB, depth fastest, then x, then y, uncompressed, so that it can be mapped.
# What Thorlabs' header has no place for stands in one element of ours, which others skip.
_DATE = (1980, 1, 1, 0, 0, 0)
"""Same scan, same bytes."""
_LEAST = np.float32(0.5)
"""Half a count: zero has no decibels."""
_MEMBER = "data\\Intensity.data"


def write_scan_oct(path: Path, scan: Scan) -> None:
    """Write an OCT scan as a ``.oct`` file; linear intensity becomes 10 log10 of it.

    Raises
    ------
    RegistrationError
        When the scan isn't OCT.
    OSError
        When the disk is full or the folder can't be written.
    """
    if scan.modality != "oct":
        raise RegistrationError(
            f"{path}: a .oct file holds OCT, not {scan.modality}; write a TIFF or OME-Zarr"
        )
    with (
        atomic_replacement(path) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_STORED) as archive,
    ):
        archive.writestr(_entry("Header.xml"), tostring(_header(scan), encoding="utf-8"))
        with archive.open(_entry(_MEMBER), "w", force_zip64=True) as handle:
            _write_intensity(handle, scan)


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo("x", _DATE)
    entry.filename = name  # as it stands: on Windows the constructor would turn backslashes
    return entry


def _write_intensity(handle: IO[bytes], scan: Scan) -> None:
    """B-scans in order, each turned so that depth runs fastest."""
    for y in range(scan.volume.shape[1]):
        handle.write(_decibels(scan.volume[:, y, :], scan.scale).T.tobytes())


def _decibels(values: NDArray[np.generic], scale: str) -> NDArray[np.float32]:
    plain = values.astype("<f4")
    if scale == "db":
        return plain
    return np.float32(10) * np.log10(np.maximum(plain, _LEAST))


def _header(scan: Scan) -> Element:
    counts = dict(zip("ZYX", scan.volume.shape, strict=True))
    # With RefractiveIndex 1 a Thorlabs header's depth is optical, else it has been divided.
    spacing = dict(zip("ZYX", scan.voxel_mm, strict=True))
    index = 1.0 if scan.optical_depth else scan.refractive_index
    root = Element("Ocity")
    SubElement(SubElement(root, "MetaInfo"), "AcquisitionMode").text = "Mode3D"
    SubElement(SubElement(root, "Acquisition"), "RefractiveIndex").text = repr(index)
    image = SubElement(root, "Image", Type="Processed")
    rows = {
        "SizePixel": counts,
        "SizeReal": {name: counts[name] * spacing[name] for name in "ZXY"},
        "PixelSpacing": spacing,
    }
    for name, values in rows.items():
        row = SubElement(image, name)
        for axis in "ZXY":
            SubElement(row, f"Size{axis}").text = repr(values[axis])
    about = {"Type": "Real", "BytesPerPixel": "4"}
    about |= {f"Size{axis}": str(counts[axis]) for axis in "ZXY"}
    about |= {f"Range{axis}": repr(counts[axis] * spacing[axis]) for axis in "ZXY"}
    stored = SubElement(SubElement(root, "DataFiles"), "DataFile", about)
    stored.text = _MEMBER
    ours = {**scan.__dict__, "scale": "db"}
    SubElement(root, OURS).text = describe(Scan(**ours))
    return root


_WRITERS: dict[str, Callable[[Path, Scan], None]] = {
    ".tif": write_scan_tiff,
    ".tiff": write_scan_tiff,
    ".oct": write_scan_oct,
    ".zarr": write_scan_zarr,
}


def write_scan(path: Path, scan: Scan) -> None:
    """Write a scan as ``.tif``, ``.oct`` or ``.zarr`` (OME-Zarr, a folder).

    Raises
    ------
    RegistrationError
        When the suffix is none of these, or the format can't hold the scan.
    OSError
        When the disk is full or the folder can't be written.
    """
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise RegistrationError(f"{path}: scans are written as {', '.join(_WRITERS)}; name it so")
    writer(path, scan)
