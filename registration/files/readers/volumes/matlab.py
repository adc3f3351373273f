"""Read a scan volume from a MATLAB ``.mat`` file of level 5, by SciPy; level 7.3 is HDF5.

Level 4, cells and structures are not read.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import (
    DEFLATE_RATIO,
    FileVolume,
    check_available,
    scan_file_errors,
)
from registration.files.readers.metadata import NAMES

MAGIC = b"MATLAB 5.0 MAT-file"

_TYPES = {"double": "f8", "single": "f4", "logical": "u1"} | {
    f"{sign}int{8 * size}": f"{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4, 8)
}
"""NumPy's types of MATLAB's numeric classes."""

_MAX_METADATA_SIZE = 64


def read_matlab(path: Path) -> FileVolume:
    """Return the one variable of three axes, with what variables named like sidecar keys say.

    ``axes`` names the array's axes as NumPy indexes them, which is MATLAB's own order of
    subscripts: ``V(z, y, x)`` is "zyx".

    Raises
    ------
    ScanFileError
        When the file is broken, or holds no volume, or several of which none is named "volume".
    """
    # SciPy takes a while to load.
    from scipy.io import loadmat, whosmat

    with scan_file_errors(path, "MATLAB file"):
        listed = whosmat(path)
        shapes = {name: shape for name, shape, kind in listed if kind in (*_TYPES, "char")}
        types = {name: np.dtype(_TYPES[kind]) for name, _, kind in listed if kind in _TYPES}
        volumes = [name for name in types if len(shapes[name]) == 3]
        named = [name for name in volumes if name == "volume"] or volumes
        if len(named) != 1:
            raise ScanFileError(
                f"{path}: holds {len(volumes)} arrays of three axes ({', '.join(volumes)}); "
                "name the scan 'volume' or leave one"
            )
        (volume,) = named
        check_available(shapes[volume], types[volume], path.stat().st_size * DEFLATE_RATIO, path)
        small = [n for n in NAMES if n in shapes and math.prod(shapes[n]) <= _MAX_METADATA_SIZE]
        with warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            try:
                values = loadmat(path, variable_names=[volume, *small], mat_dtype=True)
            except np.exceptions.ComplexWarning as exc:
                raise ScanFileError(
                    f"{path}: {volume} holds complex numbers; save abs({volume}) in its place"
                ) from exc
        counts = values[volume]
        return FileVolume(
            counts.view("u1") if counts.dtype == bool else counts,
            {name: _plain(values[name]) for name in small},
        )


def _plain(value: Any) -> Any:
    """Return a number, a text or a list of them."""
    flat = value.ravel().tolist()
    return flat[0] if len(flat) == 1 else flat
