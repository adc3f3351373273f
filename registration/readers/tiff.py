"""Read TIFF stacks (our own, OME-TIFF, ImageJ's, plain), and write scans as TIFF.

Ours carry the scan's metadata as JSON in the first ImageDescription.
"""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from design.files import atomic_replacement
from registration.errors import ScanFileError
from registration.readers.broken_files import scan_file_errors
from registration.readers.limits import (
    ANY_RATIO,
    DEFLATE_RATIO,
    IN_MEMORY_BYTES,
    bytes_of,
    check_available,
)
from registration.readers.metadata import SCHEMA, describe, parse
from registration.readers.ome import read_ome_xml
from registration.readers.raw_result import Array, FileVolume
from registration.readers.storage import fill_volume, mapped
from registration.readers.units import millimetres
from registration.scan import Scan

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""TIFF and BigTIFF, little and big endian."""

_MOST_PAGES = 100_000
_DEFLATE = (8, 32946)
_ORIENTATION = 274


def read_tiff(path: Path) -> FileVolume:
    """Volume (pages are its slowest axis) and the metadata that the file itself gives.

    Raises
    ------
    ScanFileError
        When the file is truncated or isn't a stack of equal grey images.
    """
    # Other files that an OME-TIFF names are never followed.
    with scan_file_errors(path, "TIFF"), tifffile.TiffFile(path, _multifile=False) as tiff:
        return FileVolume(_volume(tiff, path), _known(tiff, path))


def _volume(tiff: tifffile.TiffFile, path: Path) -> Array:
    pages = _pages(tiff, path)
    first = tiff.pages.first
    _check_pages(tiff, path)
    series = tiff.series[0]
    whole = tuple(series.shape)
    kind = np.dtype(first.dtype).newbyteorder(tiff.byteorder)
    if math.prod(whole) < pages * math.prod(first.shape):
        # Several series: read the pages as they come.
        whole = (pages, *first.shape)
        _check_size(tiff, whole, path)
        return fill_volume((page.asarray() for page in tiff.pages), whole, first.dtype, path)
    _check_size(tiff, whole, path)
    if bytes_of(whole, kind, path) <= IN_MEMORY_BYTES:
        return np.asarray(series.asarray())
    if series.dataoffset is not None:
        return mapped(path, kind, series.dataoffset, whole)
    return fill_volume((page.asarray() for page in series.pages), whole, first.dtype, path)


class _KeptWords(logging.Filter):
    """Takes what is logged, so that it isn't shown."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []

    def filter(self, record: logging.LogRecord) -> bool:
        self.words.append(record.getMessage())
        return False


def _pages(tiff: tifffile.TiffFile, path: Path) -> int:
    """Count the pages; of a file that ends before its list of pages tifffile only logs it."""
    log, kept = logging.getLogger("tifffile"), _KeptWords()
    log.addFilter(kept)
    try:
        pages = len(tiff.pages)
    finally:
        log.removeFilter(kept)
    if any("invalid page offset" in word for word in kept.words):
        raise ScanFileError(
            f"{path.name}: is cut short: page {pages + 1} would lie behind the end of the file; "
            "copy or export it again"
        )
    return pages


def _check_pages(tiff: tifffile.TiffFile, path: Path) -> None:
    """Refuse pictures of several sizes, and such as are stored turned or mirrored."""
    looked_at = tiff.pages if len(tiff.pages) < _MOST_PAGES else (tiff.pages[0],)
    pages = [(page.shape, _orientation(page)) for page in looked_at]
    shapes = {shape for shape, _ in pages}
    if len(shapes) > 1:
        raise ScanFileError(
            f"{path}: {len(pages)} images of {len(shapes)} different sizes aren't a stack"
        )
    for index, (_, orientation) in enumerate(pages):
        if orientation != 1:
            raise ScanFileError(
                f"{path}: page {index + 1} has the Orientation tag {orientation} (stored turned "
                "or mirrored; needed: 1, rows from the top, columns from the left); write it again "
                "upright"
            )


def _orientation(page: Any) -> int:
    tag = page.tags.get(_ORIENTATION) if isinstance(page, tifffile.TiffPage) else None
    return 1 if tag is None else int(tag.value)


def _check_size(tiff: tifffile.TiffFile, shape: tuple[int, ...], path: Path) -> None:
    """Hold the sizes against the file."""
    first, size = tiff.pages.first, path.stat().st_size
    bounds = {1: 1, **dict.fromkeys(_DEFLATE, DEFLATE_RATIO)}
    check_available(shape, first.dtype, size * bounds.get(first.compression, ANY_RATIO), path)


def _known(tiff: tifffile.TiffFile, path: Path) -> dict[str, Any]:
    text = tiff.pages.first.description
    if SCHEMA in text:
        return {"axes": "zyx", **parse(text, str(path))}
    if tiff.is_ome and tiff.ome_metadata:
        return read_ome_xml(tiff.ome_metadata, path)
    if tiff.is_imagej:
        return _of_imagej(tiff, path)
    return {}


def _of_imagej(tiff: tifffile.TiffFile, path: Path) -> dict[str, Any]:
    """ImageJ: slices are z; spacing and unit in its own text, pixels by the resolution tags."""
    metadata = tiff.imagej_metadata or {}
    tags = tiff.pages.first.tags
    unit = millimetres(metadata.get("unit"), path)
    known: dict[str, Any] = {"axes": "zyx"}
    if unit and metadata.get("spacing") and "XResolution" in tags and "YResolution" in tags:
        across, down = (tags[name].value for name in ("XResolution", "YResolution"))
        known["voxel_mm"] = [
            float(metadata["spacing"]) * unit,
            down[1] / down[0] * unit,
            across[1] / across[0] * unit,
        ]
    return known


def write_scan_tiff(path: Path, scan: Scan, *, compress: bool = False) -> None:
    """Write a scan that `read_scan` reads back exactly, by way of a temporary file.

    Speckle doesn't compress: `compress` (zlib) pays for micro-CT only.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    with atomic_replacement(path) as draft:
        tifffile.imwrite(
            draft,
            scan.volume,
            photometric="minisblack",
            compression="zlib" if compress else None,
            description=describe(scan),
            metadata=None,
        )
