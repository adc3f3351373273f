"""Read a raw binary volume laid out by a sidecar file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import FileVolume, bytes_of, mapped
from registration.files.readers.metadata import RAW_KEYS, sidecar

_KINDS = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")


def read_raw(path: Path) -> FileVolume:
    """A view of a raw file.

    ``shape`` (slowest axis first, as ``axes`` names them) and ``dtype`` are needed; ``byte_order``
    (little, big) where a number has more than one byte; ``offset_bytes`` skips a header.

    Raises
    ------
    ScanFileError
        When the sidecar doesn't say it all, or the file isn't exactly as long as it says.
    """
    metadata = sidecar(path, RAW_KEYS)
    missing = [name for name in ("shape", "dtype", "axes") if name not in metadata]
    if missing:
        raise ScanFileError(
            f"{path}: raw numbers of which {path.stem}.yaml beside it doesn't say "
            f"{', '.join(missing)}; add it (shape slowest first, like axes)"
        )
    shape, kind, offset = (
        _shape(metadata["shape"], path),
        _dtype(metadata, path),
        metadata.get("offset_bytes"),
    )
    start = offset if isinstance(offset, int) and offset >= 0 else 0
    size = path.stat().st_size - start
    if bytes_of(shape, kind, path) != size:
        raise ScanFileError(
            f"{path}: holds {size} bytes after {start} of header, but {' × '.join(map(str, shape))}"
            f" voxels of {kind} take {bytes_of(shape, kind, path)}; mend shape, dtype or "
            "offset_bytes in the sidecar"
        )
    return FileVolume(mapped(path, kind, start, shape))


def _shape(value: Any, path: Path) -> tuple[int, ...]:
    if (
        not isinstance(value, list)
        or len(value) != 3
        or not all(isinstance(size, int) and size > 0 for size in value)
    ):
        raise ScanFileError(f"{path}: shape is {value!r}; it must be three whole numbers above 0")
    return tuple(value)


def _dtype(metadata: dict[str, object], path: Path) -> np.dtype[np.generic]:
    name, order = metadata["dtype"], metadata.get("byte_order")
    if name not in _KINDS:
        raise ScanFileError(f"{path}: dtype is {name!r}; known are {', '.join(_KINDS)}")
    kind = np.dtype(name)
    if kind.itemsize == 1:
        return kind
    if order not in ("little", "big"):
        raise ScanFileError(f"{path}: byte_order is {order!r}; give little or big in the sidecar")
    return kind.newbyteorder("<" if order == "little" else ">")
