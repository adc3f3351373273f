"""Read OME-Zarr (NGFF 0.4 on Zarr 2, 0.5 on Zarr 3), finest level, by zarr (extra ``scans``).

Source: OME-NGFF 0.4 and 0.5 (ngff.openmicroscopy.org).

Not read: transformations other than scale and translation, Zarr in a zip file, remote stores.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from registration.errors import ScanFileError
from registration.files.readers.broken_files import scan_file_errors
from registration.files.readers.extras import import_extra
from registration.files.readers.limits import bytes_of
from registration.files.readers.metadata import SCHEMA, known_keys
from registration.files.readers.raw_result import Array, FileVolume
from registration.files.readers.storage import empty
from registration.files.readers.units import millimetres
from registration.files.readers.zarr_orientation import anatomical, transformed

MAX_CHUNK_BYTES = 2 << 30
MAX_CHUNKS = 4_000_000
MIN_STORED_FRACTION = 0.01
_SPACE = "zyx"


def is_zarr(path: Path) -> bool:
    """Return whether a folder is a Zarr group."""
    return any((path / name).is_file() for name in (".zgroup", ".zattrs", "zarr.json"))


def read_zarr(path: Path) -> FileVolume:
    """Read the finest level of the first image.

    Raises
    ------
    ScanFileError
        When metadata or chunks are broken, or there are several channels or time points.
    """
    zarr = import_extra("zarr", path)
    with scan_file_errors(path, "OME-Zarr"):
        attributes = zarr.open_group(path, mode="r", use_consolidated=False).attrs.asdict()
        attributes |= attributes.get("ome", {})
        image = attributes["multiscales"][0]
        name = _inside(str(image["datasets"][0]["path"]), path)
        array = zarr.open_array(path / name, mode="r")
        axes = [str(axis["name"]) for axis in image["axes"]]
        known = _known(image, axes, path)
        ours = attributes.get("printctl")
        if isinstance(ours, dict) and ours.get("schema") == SCHEMA:
            known |= {**known_keys(ours, str(path)), "axes": known["axes"]}
        _check_sizes(array, path)
        notes = _missing(array, path)
        return FileVolume(_volume(array, axes, path), known, anatomical(image, path), notes)


def _inside(name: str, path: Path) -> str:
    """Return a dataset's path, which must stay within the folder."""
    parts = name.replace("\\", "/").split("/")
    if not all(parts) or any(part in (".", "..") or ":" in part for part in parts):
        raise ScanFileError(f"{path}: dataset path {name!r} leaves the folder; export it again")
    return name


def _check_sizes(array: Any, path: Path) -> None:
    """Refuse what no scan is, before memory is taken for it."""
    if array.dtype.kind not in "uif":
        raise ScanFileError(f"{path}: grey values of type {array.dtype} aren't real numbers")
    bytes_of(array.shape, array.dtype, path)
    if bytes_of(array.chunks, array.dtype, path) > MAX_CHUNK_BYTES:
        raise ScanFileError(f"{path}: chunks of {array.chunks} voxels; export it with smaller ones")
    if array.nchunks > MAX_CHUNKS:
        raise ScanFileError(
            f"{path}: {array.nchunks} chunks (limit {MAX_CHUNKS}); export it with larger ones"
        )


def _missing(array: Any, path: Path) -> tuple[str, ...]:
    """Return a note on chunks that aren't stored: they hold the fill value."""
    total, stored = array.nchunks, array.nchunks_initialized
    if stored < max(1, MIN_STORED_FRACTION * total):
        raise ScanFileError(
            f"{path}: {stored} of its {total} chunks are there (needed: 1 %); copy it again"
        )
    if stored == total:
        return ()
    return (
        f"{total - stored} of its {total} chunks aren't there and are read as {array.fill_value}, "
        "as the format has it; if it wasn't written so, copy it again",
    )


def _known(image: dict[str, Any], axes: list[str], path: Path) -> dict[str, Any]:
    """Return order and sizes of the spatial axes."""
    named = "".join(name for name in axes if name in _SPACE)
    if sorted(named) != sorted(_SPACE):
        raise ScanFileError(f"{path}: has the axes {axes}; three of space (z, y, x) are needed")
    known: dict[str, Any] = {"axes": named}
    factors, _ = transformed(image, path)
    units = {str(axis["name"]): axis.get("unit") for axis in image["axes"]}
    voxel = []
    for name in _SPACE:
        unit = millimetres(units.get(name), path)
        if name in axes and unit:
            voxel.append(factors[axes.index(name)] * unit)
    if len(voxel) == 3:
        known["voxel_mm"] = voxel
    return known


def _volume(array: Any, axes: list[str], path: Path) -> Array:
    """Read slab by slab of whole chunks; an axis that isn't of space must be of length 1."""
    if len(axes) != array.ndim:
        raise ScanFileError(f"{path}: {len(axes)} axes for an array of {array.ndim}")
    space = [at for at, name in enumerate(axes) if name in _SPACE]
    if any(size != 1 for at, size in enumerate(array.shape) if at not in space):
        raise ScanFileError(f"{path}: has the axes {axes} of {array.shape}; export one volume")
    out = empty([array.shape[at] for at in space], array.dtype.newbyteorder("="), path)
    where: list[slice | int] = [slice(None) if at in space else 0 for at in range(array.ndim)]
    step = (array.shards or array.chunks)[space[0]]
    for first in range(0, out.shape[0], step):
        where[space[0]] = slice(first, first + step)
        out[first : first + step] = array[tuple(where)]
    return out
