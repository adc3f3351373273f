"""Read a scan, its format chosen by its first bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.readers import npz, tiff
from registration.readers.metadata import ScanOverrides, build_scan, sidecar
from registration.scan import Scan

Reader = Callable[[Path], tuple[NDArray[np.generic], dict[str, Any]]]

_READERS: dict[tuple[bytes, ...], Reader] = {
    tiff.MAGIC: tiff.read_tiff,
    npz.MAGIC: npz.read_npz,
}


def read_scan(path: Path, overrides: ScanOverrides | None = None) -> Scan:
    """Read a TIFF stack or an ``.npz`` archive.

    Units and kin come from the file, from ``NAME.json`` beside it, or from `overrides`, the later
    over the earlier; nothing is guessed.

    Raises
    ------
    ScanFileError
        When the file is missing, of no known format, broken, or doesn't say what it must.
    """
    if not path.is_file():
        raise ScanFileError(f"{path}: no such scan; check the path")
    with path.open("rb") as handle:
        start = handle.read(4)
    for magic, reader in _READERS.items():
        if start in magic:
            volume, found = reader(path)
            known = {**found, **sidecar(path)}
            return build_scan(volume, known, overrides or ScanOverrides(), path)
    raise ScanFileError(
        f"{path}: neither TIFF nor .npz by its first bytes ({start.hex(' ')}); "
        "export the scan as a TIFF stack"
    )
