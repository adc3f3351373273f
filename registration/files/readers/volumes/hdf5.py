"""Read a scan volume from HDF5 or a MATLAB 7.3 file, by h5py (extra ``scans``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import (
    ANY_RATIO,
    Array,
    FileVolume,
    bytes_of,
    check_available,
    empty,
    import_extra,
    scan_file_errors,
)
from registration.files.readers.metadata import NAMES

MAGIC = b"\x89HDF\r\n\x1a\n"
_MOST_OBJECTS = 10_000
_SLAB_BYTES = 64 << 20
_MATLAB = "MATLAB_class"
"""Attribute of every array in a MATLAB file."""


def read_hdf5(path: Path) -> FileVolume:
    """The one dataset of three axes, with what its attributes or datasets beside it say.

    Attributes of the dataset, of the file, and scalar datasets are looked up by the names of a
    sidecar's keys (``voxel_mm``, ``axes``, ``scale``, ...). ``axes`` names NumPy's order of
    indices, in a file written by MATLAB (7.3) the order of its subscripts, as in level 5:
    ``V(z, y, x)`` is "zyx".

    Raises
    ------
    ScanFileError
        When the file is broken, or holds no volume, or several of which none is named "volume".
    """
    h5py = import_extra("h5py", path)
    with scan_file_errors(path, "HDF5"), h5py.File(path, "r") as file:
        volumes = _volumes(file, h5py)
        data = _the_one(volumes, path)
        # A link into another file is not followed: it could point anywhere.
        if data.external:
            raise ScanFileError(f"{path}: its data lies in other files; export it as one")
        known = {**_said(file, file.attrs), **_said({}, data.attrs)}
        volume = _read(data, path)
        # MATLAB stores columns first, HDF5 rows first: transposed, subscripts are MATLAB's own.
        return FileVolume(volume.T if _MATLAB in data.attrs else volume, known)


def _volumes(file: Any, h5py: Any) -> dict[str, object]:
    volumes: dict[str, object] = {}

    def look(name: str, item: Any) -> bool | None:
        if isinstance(item, h5py.Dataset) and item.ndim == 3 and item.dtype.kind in "uif":
            volumes[name] = item
        return True if len(volumes) > _MOST_OBJECTS else None

    file.visititems(look)
    return volumes


def _the_one(volumes: dict[str, object], path: Path) -> Any:
    named = [name for name in volumes if name.split("/")[-1] == "volume"]
    if len(named) == 1:
        return volumes[named[0]]
    if len(volumes) != 1:
        raise ScanFileError(
            f"{path}: holds {len(volumes)} arrays of three axes ({', '.join(volumes) or 'none'}); "
            "name the scan 'volume' or leave one"
        )
    return next(iter(volumes.values()))


def _said(group: Any, attributes: Any) -> dict[str, object]:
    known: dict[str, object] = {}
    for name in NAMES:
        if name in attributes:
            known[name] = _plain(attributes[name])
        elif name in group and hasattr(group[name], "size") and group[name].size <= 16:
            known[name] = _of_matlab(group[name]) or _plain(group[name][()])
    return known


def _of_matlab(data: Any) -> str | None:
    """MATLAB's text, which HDF5 holds as codes; None for anything else."""
    if _plain(data.attrs.get(_MATLAB, b"")) != "char":
        return None
    return "".join(map(chr, np.ravel(data[()]).tolist()))


def _plain(value: Any) -> Any:
    """A NumPy or bytes value as JSON would hold it."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray):
        flat = [_plain(item) for item in value.ravel().tolist()]
        return flat[0] if len(flat) == 1 else flat
    return value.item() if isinstance(value, np.generic) else value


def _read(data: Any, path: Path) -> Array:
    """Slab by slab, into memory or, where it is large, a nameless file."""
    bytes_of(data.shape, data.dtype, path)
    stored = int(data.id.get_storage_size())
    if stored == 0:
        raise ScanFileError(f"{path}: its array was never written; export it again")
    check_available(data.shape, data.dtype, stored * ANY_RATIO, path)
    out = empty(data.shape, data.dtype, path)
    step = max(1, _SLAB_BYTES * data.shape[0] // max(1, out.nbytes))
    for first in range(0, data.shape[0], step):
        out[first : first + step] = data[first : first + step]
    return out
