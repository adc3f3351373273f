"""Read OME-Zarr (NGFF 0.4 and 0.5), finest level, with its orientation (RFC-4)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import (
    LPS,
    Array,
    FileSpace,
    FileVolume,
    bytes_of,
    empty,
    file_space,
    import_extra,
    known_voxel,
    millimetres,
    scan_file_errors,
)
from registration.files.readers.metadata import SCHEMA, known_keys

_SPACE = ("x", "y", "z")
_PLACES = {
    "left": (1.0, 0.0, 0.0), "right": (-1.0, 0.0, 0.0),
    "posterior": (0.0, 1.0, 0.0), "anterior": (0.0, -1.0, 0.0),
    "superior": (0.0, 0.0, 1.0), "inferior": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Towards which an axis runs, in LPS."""


def transformed(image: Mapping[str, Any], path: Path) -> tuple[list[float], list[float]]:
    """Scale and translation of each axis, of the finest level and then of the whole image.

    Raises
    ------
    ScanFileError
        When an axis of space runs backwards, or another kind of transformation is asked for.
    """
    axes = [str(axis["name"]) for axis in image["axes"]]
    factors, shifts = [1.0] * len(axes), [0.0] * len(axes)
    for source in (image["datasets"][0], image):
        for step in source.get("coordinateTransformations", ()):
            kind = step.get("type")
            if kind not in ("identity", "scale", "translation"):
                raise ScanFileError(
                    f"{path}: its coordinateTransformations hold {kind!r}; only scale and "
                    "translation are read: resample it, or export it as OME-Zarr 0.4 or 0.5"
                )
            if kind == "scale":
                factors = [a * float(b) for a, b in zip(factors, step["scale"], strict=True)]
                shifts = [a * float(b) for a, b in zip(shifts, step["scale"], strict=True)]
            elif kind == "translation":
                shifts = [a + float(b) for a, b in zip(shifts, step["translation"], strict=True)]
    for name, factor in zip(axes, factors, strict=True):
        if name in _SPACE and not factor > 0:
            raise ScanFileError(
                f"{path}: its axis {name} has the scale {factor:g}, so that it runs backwards; "
                "reverse the array along it and write a scale above 0"
            )
    return factors, shifts


def anatomical(image: Mapping[str, Any], path: Path) -> FileSpace | None:
    """How the spatial axes run, from "left-to-right" and its like; None where nothing is said.

    Raises
    ------
    ScanFileError
        When only some axes say it, or by words that aren't the patient's six.
    """
    spatial = [axis for axis in image["axes"] if axis["name"] in _SPACE]
    orientations = [axis.get("orientation") for axis in spatial]
    if not any(orientations):
        return None
    steps = []
    for axis, orientation in zip(spatial, orientations, strict=True):
        value = orientation.get("value", "") if isinstance(orientation, dict) else ""
        start, _, end = str(value).partition("-to-")
        if end not in _PLACES or _PLACES.get(start) != tuple(-v for v in _PLACES[end]):
            raise ScanFileError(
                f"{path}: axis {axis['name']} has the orientation {value!r}; known are two of "
                f"{', '.join(_PLACES)} opposite each other, like left-to-right"
            )
        steps.append(_PLACES[end])
    _, shifts = transformed(image, path)
    origin = np.zeros(3)
    for axis, shift in zip(image["axes"], shifts, strict=True):
        if axis["name"] in _SPACE:
            unit = millimetres(axis.get("unit")) or 1.0
            origin += shift * unit * np.array(steps[spatial.index(axis)])
    return file_space(LPS, steps, origin, path)


MAX_CHUNK_BYTES = 2 << 30
MAX_CHUNKS = 4_000_000
MIN_STORED_FRACTION = 0.01
_AXIS_ORDER = "zyx"


def is_zarr(path: Path) -> bool:
    """Return whether a folder is a Zarr group."""
    return any((path / name).is_file() for name in (".zgroup", ".zattrs", "zarr.json"))


def read_zarr(path: Path) -> FileVolume:
    """Read the finest level of the image, or of the only image of a group of images.

    Raises
    ------
    ScanFileError
        When metadata or chunks are broken, or there are several images, channels or time points.
    """
    zarr = import_extra("zarr", path)
    with scan_file_errors(path, "OME-Zarr"):
        form = 3 if (path / "zarr.json").is_file() else 2
        attributes = _attributes(zarr, path, form)
        attributes |= attributes.get("ome", {})
        if "multiscales" not in attributes:
            return _first_image(path, attributes)
        image = attributes["multiscales"][0]
        name = _inside(str(image["datasets"][0]["path"]), path)
        array = zarr.open_array(path / name, mode="r", zarr_format=form)
        axes = [str(axis["name"]) for axis in image["axes"]]
        known, notes = _known(image, axes, path)
        ours = attributes.get("printctl")
        if isinstance(ours, dict) and ours.get("schema") == SCHEMA:
            known |= {**known_keys(ours, str(path)), "axes": known["axes"]}
        _check_sizes(array, path)
        notes = (*notes, *_missing(array, path))
        return FileVolume(_volume(array, axes, path), known, anatomical(image, path), notes)


def _first_image(path: Path, attributes: Mapping[str, Any]) -> FileVolume:
    """Read the only image of a group of images (bioformats2raw: 0, 1, ...).

    Raises
    ------
    ScanFileError
        When the group holds none or several, which are then named, or is a plate of wells.
    """
    if "plate" in attributes:
        field = Path(path, str(attributes["plate"]["wells"][0]["path"]), "0")
        raise ScanFileError(f"{path}: is a plate of wells; give one image of it, like {field}")
    within = (one for one in path.iterdir() if one.name.isdigit() and is_zarr(one))
    images = sorted(within, key=lambda one: int(one.name))
    if not images:
        raise ScanFileError(f"{path}: has no image metadata (multiscales); export it again")
    if len(images) > 1:
        raise ScanFileError(
            f"{path}: holds {len(images)} images; give one of them: {', '.join(map(str, images))}"
        )
    volume = read_zarr(images[0])
    return replace(volume, notes=(f"image {images[0].name} of it was read", *volume.notes))


def _attributes(zarr: Any, path: Path, form: int) -> dict[str, Any]:
    """The group's attributes; of version 2 also where its ``.zgroup`` is missing."""
    if form == 2 and not (path / ".zgroup").is_file():
        return dict(json.loads((path / ".zattrs").read_text(encoding="utf-8")))
    group = zarr.open_group(path, mode="r", use_consolidated=False, zarr_format=form)
    return dict(group.attrs.asdict())


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


def _known(
    image: Mapping[str, Any], axes: list[str], path: Path
) -> tuple[dict[str, object], tuple[str, ...]]:
    """Return order and sizes of the spatial axes, and notes on their units."""
    named = "".join(name for name in axes if name in _AXIS_ORDER)
    if sorted(named) != sorted(_AXIS_ORDER):
        raise ScanFileError(f"{path}: has the axes {axes}; three of space (z, y, x) are needed")
    factors, _ = transformed(image, path)
    units = {str(axis["name"]): axis.get("unit") for axis in image["axes"]}
    sizes = [factors[axes.index(name)] for name in _AXIS_ORDER]
    known, notes = known_voxel(sizes, [units[name] for name in _AXIS_ORDER])
    return {"axes": named, **known}, notes


def _volume(array: Any, axes: list[str], path: Path) -> Array:
    """Read slab by slab of whole chunks; an axis that isn't of space must be of length 1."""
    if len(axes) != array.ndim:
        raise ScanFileError(f"{path}: {len(axes)} axes for an array of {array.ndim}")
    space = [at for at, name in enumerate(axes) if name in _AXIS_ORDER]
    if any(size != 1 for at, size in enumerate(array.shape) if at not in space):
        raise ScanFileError(f"{path}: has the axes {axes} of {array.shape}; export one volume")
    out = empty([array.shape[at] for at in space], array.dtype.newbyteorder("="), path)
    where: list[slice | int] = [slice(None) if at in space else 0 for at in range(array.ndim)]
    step = (array.shards or array.chunks)[space[0]]
    for first in range(0, out.shape[0], step):
        where[space[0]] = slice(first, first + step)
        out[first : first + step] = array[tuple(where)]
    return out
