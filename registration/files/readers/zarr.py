"""Read OME-Zarr (NGFF 0.4 on Zarr 2, 0.5 on Zarr 3): finest level of a folder of chunks.

Read by our own few lines: the format is JSON and one file a chunk. Sources: OME-NGFF 0.4 and 0.5
(ngff.openmicroscopy.org), Zarr 2 and 3 specifications (zarr-specs.readthedocs.io).

Not read: transformations other than scale and translation, sharded chunks of Zarr 3, Zarr in a zip
file, remote stores.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.limits import bytes_of
from registration.files.readers.metadata import SCHEMA, known_keys
from registration.files.readers.raw_result import Array, FileVolume
from registration.files.readers.storage import empty
from registration.files.readers.units import millimetres
from registration.files.readers.zarr_codecs import decode
from registration.files.readers.zarr_orientation import anatomical, transformed

_MOST_JSON_BYTES = 64 << 20
_MOST_CHUNK_BYTES = 2 << 30
_MOST_CHUNKS = 4_000_000
_LEAST_THERE = 0.01
_SPACE = "zyx"


@dataclass(frozen=True)
class _Grid:
    """An array's metadata, the same for Zarr 2 and 3.

    ``prefix`` and ``separator`` make a chunk's name; ``codec`` is None for plain bytes.
    """

    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    dtype: np.dtype[np.generic]
    codec: dict[str, Any] | None
    fill: float
    prefix: str
    separator: str
    by_columns: bool


def is_zarr(path: Path) -> bool:
    """Whether a folder is a Zarr group."""
    return any((path / name).is_file() for name in (".zgroup", ".zattrs", "zarr.json"))


def read_zarr(path: Path) -> FileVolume:
    """The finest level of the first image.

    Raises
    ------
    ScanFileError
        When metadata or chunks are broken, or there are several channels or time points.
    """
    try:
        attributes = _attributes(path)
        image = attributes["multiscales"][0]
        place = path / _inside(str(image["datasets"][0]["path"]), path)
        grid = _grid(place, path)
        axes = [str(axis["name"]) for axis in image["axes"]]
        known = _known(image, axes, path)
        ours = attributes.get("printctl")
        if isinstance(ours, dict) and ours.get("schema") == SCHEMA:
            known |= {**known_keys(ours, str(path)), "axes": known["axes"]}
        volume, notes = _volume(place, grid, axes, path)
        return FileVolume(volume, known, anatomical(image, path), notes)
    except (KeyError, IndexError, TypeError, ValueError) as exc:
        if isinstance(exc, ScanFileError):
            raise
        raise ScanFileError(f"{path}: broken OME-Zarr ({exc!r}); export it again") from exc


def _inside(name: str, path: Path) -> str:
    """A dataset's path, which must stay within the folder."""
    parts = name.replace("\\", "/").split("/")
    if not all(parts) or any(part in (".", "..") or ":" in part for part in parts):
        raise ScanFileError(f"{path}: dataset path {name!r} leaves the folder; export it again")
    return name


def _json(place: Path) -> Any:
    if place.stat().st_size > _MOST_JSON_BYTES:
        raise ScanFileError(f"{place}: metadata of {place.stat().st_size} bytes; export it again")
    return json.loads(place.read_text(encoding="utf-8"))


def _attributes(path: Path) -> dict[str, Any]:
    if (path / "zarr.json").is_file():
        attributes = _json(path / "zarr.json").get("attributes", {})
        return dict(attributes.get("ome", {})) | {k: v for k, v in attributes.items() if k != "ome"}
    if (path / ".zattrs").is_file():
        return dict(_json(path / ".zattrs"))
    raise ScanFileError(f"{path}: has no image metadata (multiscales); export it as OME-Zarr")


def _grid(place: Path, path: Path) -> _Grid:
    if (place / ".zarray").is_file():
        grid = _grid_2(_json(place / ".zarray"), path)
    elif (place / "zarr.json").is_file():
        grid = _grid_3(_json(place / "zarr.json"), path)
    else:
        raise ScanFileError(f"{path}: its array {place.name!r} is missing; copy it again")
    bytes_of(grid.shape, grid.dtype, path)
    if len(grid.chunk) != len(grid.shape) or (
        bytes_of(grid.chunk, grid.dtype, path) > _MOST_CHUNK_BYTES
    ):
        raise ScanFileError(f"{path}: chunks of {grid.chunk} voxels; export it with smaller ones")
    return grid


def _grid_2(metadata: dict[str, Any], path: Path) -> _Grid:
    if metadata.get("filters"):
        raise ScanFileError(f"{path}: its chunks are filtered; export it without filters")
    return _Grid(
        tuple(int(n) for n in metadata["shape"]),
        tuple(int(n) for n in metadata["chunks"]),
        _dtype(str(metadata["dtype"]), path),
        metadata.get("compressor"),
        _fill(metadata.get("fill_value")),
        "",
        str(metadata.get("dimension_separator", ".")),
        metadata.get("order") == "F",
    )


def _grid_3(metadata: dict[str, Any], path: Path) -> _Grid:
    kind, codec = _dtype(str(metadata["data_type"]), path), None
    for step in metadata["codecs"]:
        name, options = step["name"], step.get("configuration", {})
        if name == "bytes":
            kind = kind.newbyteorder(">" if options.get("endian") == "big" else "<")
        elif name in ("gzip", "blosc", "zstd"):
            codec = {"id": name}
        else:
            raise ScanFileError(f"{path}: codec {name!r} isn't read; export it without")
    key = metadata.get("chunk_key_encoding", {"name": "default"})
    separator = key.get("configuration", {}).get("separator")
    default = key["name"] == "default"
    return _Grid(
        tuple(int(n) for n in metadata["shape"]),
        tuple(int(n) for n in metadata["chunk_grid"]["configuration"]["chunk_shape"]),
        kind,
        codec,
        _fill(metadata.get("fill_value")),
        "c" if default else "",
        separator or ("/" if default else "."),
        False,
    )


def _dtype(name: str, path: Path) -> np.dtype[np.generic]:
    kind = np.dtype(name)
    if kind.kind not in "uif":
        raise ScanFileError(f"{path}: grey values of type {name} aren't real numbers")
    return kind


def _fill(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


def _known(image: dict[str, Any], axes: list[str], path: Path) -> dict[str, Any]:
    """Order and sizes of the spatial axes; one of the others must be of length 1."""
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


def _volume(place: Path, grid: _Grid, axes: list[str], path: Path) -> tuple[Array, tuple[str, ...]]:
    """Chunk by chunk, and what to say of chunks that aren't there: they hold the fill value."""
    if len(axes) != len(grid.shape):
        raise ScanFileError(f"{path}: {len(axes)} axes for an array of {len(grid.shape)}")
    keep = [at for at, name in enumerate(axes) if name in _SPACE]
    if any(grid.shape[at] != 1 for at in range(len(axes)) if at not in keep):
        raise ScanFileError(f"{path}: has the axes {axes} of {grid.shape}; export one volume")
    shape = tuple(grid.shape[at] for at in keep)
    counts = [math.ceil(n / c) for n, c in zip(grid.shape, grid.chunk, strict=True)]
    total, there = math.prod(counts), _count_there(place, grid, counts, path)
    out = empty(shape, grid.dtype, path)
    for index in itertools.product(*map(range, counts)):
        file = place.joinpath(*_name(grid, index))
        where = tuple(
            slice(index[at] * grid.chunk[at], (index[at] + 1) * grid.chunk[at]) for at in keep
        )
        if file.is_file():
            out[where] = _chunk(file, grid, keep, [out[where].shape[i] for i in range(3)])
        else:
            out[where] = grid.fill
    if there == total:
        return out, ()
    return out, (
        f"{total - there} of its {total} chunks aren't there and are read as {grid.fill:g}, as the "
        "format has it; if it wasn't written so, copy it again",
    )


def _count_there(place: Path, grid: _Grid, counts: list[int], path: Path) -> int:
    """Chunks that are there; refuse an array most of which was never written, before it's read."""
    total = math.prod(counts)
    if total > _MOST_CHUNKS:
        raise ScanFileError(
            f"{path}: {total} chunks (limit {_MOST_CHUNKS}); export it with larger ones"
        )
    names = (_name(grid, index) for index in itertools.product(*map(range, counts)))
    there = sum(place.joinpath(*name).is_file() for name in names)
    if there < max(1, _LEAST_THERE * total):
        raise ScanFileError(
            f"{path}: {there} of its {total} chunks are there (needed: 1 %); copy it again"
        )
    return there


def _name(grid: _Grid, index: tuple[int, ...]) -> list[str]:
    numbers = [str(number) for number in index]
    if grid.separator == "/":
        return [grid.prefix, *numbers] if grid.prefix else numbers
    return [grid.separator.join([grid.prefix, *numbers] if grid.prefix else numbers)]


def _chunk(file: Path, grid: _Grid, keep: list[int], within: list[int]) -> Array:
    expected = bytes_of(grid.chunk, grid.dtype, file)
    if file.stat().st_size > 2 * expected + 4096:
        raise ScanFileError(f"{file}: {file.stat().st_size} bytes for a chunk of {expected}")
    plain = decode(file.read_bytes(), grid.codec, expected, file)
    values = np.frombuffer(plain, grid.dtype).reshape(
        grid.chunk, order="F" if grid.by_columns else "C"
    )
    # Of an axis that isn't of space, only the first place holds voxels.
    space = values[tuple(slice(None) if at in keep else 0 for at in range(values.ndim))]
    return space[: within[0], : within[1], : within[2]]
