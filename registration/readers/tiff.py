"""TIFF stacks, with the scan's metadata as JSON in the first ImageDescription."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from design.files import replacing
from registration.errors import ScanFileError
from registration.readers.metadata import SCHEMA, describe, parse
from registration.scan import Scan

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""TIFF and BigTIFF, little and big endian."""


def read_tiff(path: Path) -> tuple[NDArray[np.generic], dict[str, Any]]:
    """Volume (pages become z) and the metadata that the file itself gives.

    Raises
    ------
    ScanFileError
        When the file is truncated or isn't a stack of equal grey images.
    """
    try:
        with tifffile.TiffFile(path) as tiff:
            volume = _volume(tiff, path)
            text = tiff.pages.first.description
    except ScanFileError:
        raise
    except Exception as exc:
        # The library raises whatever the broken bytes happen to trip.
        raise ScanFileError(f"{path}: broken TIFF ({exc}); export or copy it again") from exc
    return volume, parse(text, str(path)) if SCHEMA in text else {}


def _volume(tiff: tifffile.TiffFile, path: Path) -> NDArray[np.generic]:
    pages = len(tiff.pages)
    shapes = {page.shape for page in tiff.pages} if pages < 100_000 else set()
    if len(shapes) > 1:
        raise ScanFileError(
            f"{path}: {pages} images of {len(shapes)} different sizes aren't a stack"
        )
    volume = tiff.asarray()
    expected = pages * int(np.prod(tiff.pages.first.shape))
    if volume.size < expected:
        # Several series: read the pages as they come.
        volume = np.stack([page.asarray() for page in tiff.pages])
    return np.asarray(volume)


def write_scan_tiff(path: Path, scan: Scan, *, compress: bool = False) -> None:
    """Write a scan that `read_scan` reads back exactly, by way of a temporary file.

    Speckle doesn't compress: `compress` (zlib) pays for micro-CT only.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    with replacing(path) as draft:
        tifffile.imwrite(
            draft,
            scan.volume,
            photometric="minisblack",
            compression="zlib" if compress else None,
            description=describe(scan),
            metadata=None,
        )
