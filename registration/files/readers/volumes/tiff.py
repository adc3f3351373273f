"""Read TIFF stacks (our own, OME-TIFF, ImageJ's, plain), and write scans as TIFF."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from design.files import atomic_replacement
from registration.errors import ScanFileError
from registration.files.readers.common import (
    ANY_RATIO,
    DEFLATE_RATIO,
    IN_MEMORY_BYTES,
    Array,
    FileVolume,
    bytes_of,
    check_available,
    fill_volume,
    known_voxel,
    mapped,
    millimetres,
    parse_xml,
    scan_file_errors,
)
from registration.files.readers.metadata import SCHEMA, describe, parse
from registration.scan import Scan


def read_ome_xml(text: str, path: Path) -> tuple[dict[str, object], tuple[str, ...]]:
    """Read the first image's ``Pixels`` (OME schema 2016-06: sizes in µm by default).

    Raises
    ------
    ScanFileError
        When there are several channels or time points.
    """
    pixels = parse_xml(text, path).find(".//{*}Pixels")
    if pixels is None:
        return {}, ()
    for name, what in (("SizeC", "channels"), ("SizeT", "time points")):
        if pixels.get(name, "1") != "1":
            raise ScanFileError(f"{path}: has {pixels.get(name)} {what}; export one")
    order = pixels.get("DimensionOrder", "XYZCT")
    axes = "".join(name for name in reversed(order) if name in "XYZ").lower()
    sizes = [pixels.get(f"PhysicalSize{name}") for name in "ZYX"]
    units = [pixels.get(f"PhysicalSize{name}Unit", "µm") for name in "ZYX"]
    known, notes = known_voxel(sizes, units)
    return {"axes": axes, **known}, notes


MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""TIFF and BigTIFF, little and big endian."""
_MOST_PAGES = 100_000
_DEFLATE = (8, 32946)
_READ = (1, *_DEFLATE, 32773)
"""None, Deflate, PackBits: what is read without further libraries."""
_ORIENTATION = 274
_WHITE_IS_ZERO, _PALETTE = 0, 3
_INVERTED = "white is zero in it (WhiteIsZero): its values were inverted, high being bright"
_MAX_ASPECT = 100.0
"""Of a pixel: no scanner's is as long as that."""
_NUMBERED = re.compile(r"(?!\.).*\d.*\.tiff?", re.IGNORECASE)
"""Name of a slice."""


def read_tiff(path: Path) -> FileVolume:
    """Volume (pages are its slowest axis) and the metadata that the file itself gives.

    Raises
    ------
    ScanFileError
        When the file is truncated or isn't a stack of equal grey images.
    """
    # Other files that an OME-TIFF names are never followed.
    with scan_file_errors(path, "TIFF"), tifffile.TiffFile(path, _multifile=False) as tiff:
        known, notes = _known(tiff, path)
        notes = (*notes, *_check_images(tiff, path))
        if tiff.pages.first.photometric == _WHITE_IS_ZERO:
            notes = (*notes, _INVERTED)
        return FileVolume(_volume(tiff, path), known, notes=notes)


def read_tiff_folder(path: Path) -> FileVolume:
    """Read a folder of numbered TIFF slices (micro-CT) as a stack, slice 2 before slice 10.

    Raises
    ------
    ScanFileError
        When the slices are of several series, sizes or types, or one isn't a single grey image.
    """
    slices, notes = _numbered(path)
    seen: dict[str, Path] = {}
    for file in slices:
        with scan_file_errors(file, "TIFF"), tifffile.TiffFile(file, _multifile=False) as tiff:
            if _pages(tiff, file) > 1:
                raise ScanFileError(
                    f"{file}: holds {len(tiff.pages)} images, in a folder of single slices; give "
                    "that file alone, or one image a file"
                )
            _check_pages(tiff, file)
            page = tiff.pages.first
            _check_size(tiff, page.shape, file)
            white = ", WhiteIsZero" if page.photometric == _WHITE_IS_ZERO else ""
            size = " × ".join(str(pixels) for pixels in page.shape)
            seen.setdefault(f"{size} of {_stored(page)}{white}", file)
            whole, kind = (len(slices), *page.shape), _stored(page)
    if len(seen) > 1:
        told = "; ".join(f"{file.name}: {what}" for what, file in seen.items())
        raise ScanFileError(
            f"{path}: its slices differ in size or type ({told}); move what isn't of the scan "
            "elsewhere, or export them alike"
        )
    volume = fill_volume((_slice(file) for file in slices), whole, kind, path)
    return FileVolume(volume, notes=(*notes, *((_INVERTED,) if white else ())))


def has_slices(folder: Path) -> bool:
    """Return whether a folder holds numbered TIFF files."""
    return any(_NUMBERED.fullmatch(one.name) and one.is_file() for one in folder.iterdir())


def _numbered(folder: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Slices in the order of their numbers, and what of the folder isn't read or is missing."""
    alike: dict[tuple[str, ...], list[tuple[list[str], Path]]] = {}
    others: list[str] = []
    for place in sorted(folder.iterdir()):
        if _NUMBERED.fullmatch(place.name) is None or not place.is_file():
            others.append(place.name)
            continue
        pieces = re.split(r"(\d+)", place.stem)
        texts = (*pieces[:-1:2], pieces[-1].lower())
        alike.setdefault(texts, []).append((pieces[1::2], place))
    found: dict[str, dict[int, Path]] = {}
    for texts, named in alike.items():
        columns = [
            {int(text) for text in column}
            for column in zip(*(one for one, _ in named), strict=True)
        ]
        order = max((k for k, column in enumerate(columns) if len(column) > 1), default=-1)
        for digits, place in named:
            number = int(digits[order])
            plain = [str(int(text)) for text in digits]
            plain[order] = "*"
            name = "".join(a + b for a, b in zip(texts, [*plain, ""], strict=True))
            twin = found.setdefault(name, {}).setdefault(number, place)
            if twin is not place:
                raise ScanFileError(
                    f"{folder}: {twin.name} and {place.name} have one number; drop one"
                )
    if len(found) > 1:
        names = ", ".join(f"{name} ({len(files)})" for name, files in found.items())
        raise ScanFileError(f"{folder}: holds several series of slices: {names}; give one a folder")
    ((_, files),) = found.items()
    if len(files) < 2:
        raise ScanFileError(
            f"{folder}: holds one slice ({files.popitem()[1].name}); a scan has more"
        )
    numbers = sorted(files)
    notes = [f"{len(numbers)} slices, {files[numbers[0]].name} to {files[numbers[-1]].name}"]
    steps = np.diff(numbers)
    if len(set(steps.tolist())) > 1:
        gap = int(np.argmax(steps > steps.min()))
        notes.append(
            f"numbers are missing between {files[numbers[gap]].name} and "
            f"{files[numbers[gap + 1]].name}: slices are taken as evenly spaced"
        )
    if others:
        notes.append(f"{len(others)} other files in the folder weren't read ({others[0]}, ...)")
    return [files[number] for number in numbers], tuple(notes)


def _slice(file: Path) -> Array:
    with scan_file_errors(file, "TIFF"), tifffile.TiffFile(file, _multifile=False) as tiff:
        return _grey(tiff.pages.first.asarray(), tiff.pages.first, file)


def _volume(tiff: tifffile.TiffFile, path: Path) -> Array:
    pages = _pages(tiff, path)
    first = tiff.pages.first
    _check_pages(tiff, path)
    series = tiff.series[0]
    whole = tuple(series.shape)
    kind = _stored(first).newbyteorder(tiff.byteorder)
    each = (_grey(page.asarray(), first, path) for page in tiff.pages)
    if math.prod(whole) < pages * math.prod(first.shape):
        # Several series: read the pages as they come.
        whole = (pages, *first.shape)
        _check_size(tiff, whole, path)
        return fill_volume(each, whole, _stored(first), path)
    _check_size(tiff, whole, path)
    if bytes_of(whole, kind, path) <= IN_MEMORY_BYTES:
        return _grey(np.asarray(series.asarray()), first, path)
    if series.dataoffset is not None and first.photometric not in (_WHITE_IS_ZERO, _PALETTE):
        return mapped(path, kind, series.dataoffset, whole)
    each = (_grey(page.asarray(), first, path) for page in series.pages)
    return fill_volume(each, whole, _stored(first), path)


def _stored(page: Any) -> np.dtype[Any]:
    """Type of a page's values once read: bits become bytes, colours of a palette 16-bit greys."""
    if page.photometric == _PALETTE:
        return np.dtype(np.uint16)
    kind = np.dtype(page.dtype)
    return np.dtype(np.uint8) if kind.kind == "b" else kind


def _grey(values: Array, page: Any, path: Path) -> Array:
    """Values that rise with brightness, whatever the file says of white and black."""
    if page.photometric == _PALETTE:
        red, green, blue = page.colormap
        if (red != green).any() or (red != blue).any():
            raise ScanFileError(
                f"{path}: its pixels are colours of a palette (photometric 3), so its brightness "
                "isn't known; export it in grey"
            )
        looked_up: Array = red[np.asarray(values, np.intp)]
        return looked_up
    grey = np.asarray(values, _stored(page).newbyteorder(values.dtype.byteorder))
    if page.photometric != _WHITE_IS_ZERO:
        return grey
    if grey.dtype.kind not in "ui":
        raise ScanFileError(
            f"{path}: white is zero in it (WhiteIsZero), and which of its {grey.dtype} values is "
            "black isn't said; export it as BlackIsZero"
        )
    # Of signed integers ~v is min + max - v.
    inverted: Array = (2**page.bitspersample - 1) - grey if grey.dtype.kind == "u" else ~grey
    return inverted.astype(grey.dtype)


class _KeptWords(logging.Filter):
    """Takes what is logged, so that it isn't shown."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []

    def filter(self, record: logging.LogRecord) -> bool:
        self.words.append(record.getMessage())
        return False


@contextmanager
def _kept_log() -> Iterator[list[str]]:
    """Keep what tifffile logs: of a damaged file it often does nothing else."""
    log, kept = logging.getLogger("tifffile"), _KeptWords()
    log.addFilter(kept)
    try:
        yield kept.words
    finally:
        log.removeFilter(kept)


def _check_images(tiff: tifffile.TiffFile, path: Path) -> tuple[str, ...]:
    """Compare the images that the file's text names with those it holds; return notes."""
    pages = _pages(tiff, path)
    with _kept_log():
        series = tiff.series[0]
    each = math.prod(tiff.pages.first.shape)
    held = pages if series.dataoffset is None else max(pages, math.prod(series.shape) // each)
    imagej = tiff.imagej_metadata or {}
    named = int(imagej.get("images", 0)) or math.prod(series.shape) // each
    if named > held:
        raise ScanFileError(
            f"{path}: is cut short: its text names {named} images, it holds {held}; copy or "
            "export it again"
        )
    if series.axes[:1] == "T" and len(series.shape) == 3:
        raise ScanFileError(
            f"{path}: its {held} images are points in time (frames), not slices; give one point "
            "in time, or have them called slices (ImageJ: Image, Properties) and save it again"
        )
    notes = []
    if imagej and named < held:
        notes.append(f"its text names {named} images, it holds {held}: all were read")
    if series.axes[:1] == "C" and len(series.shape) == 3:
        notes.append(f"its {held} images are called channels: they were taken as slices")
    return tuple(notes)


def _pages(tiff: tifffile.TiffFile, path: Path) -> int:
    """Count the pages; of a file that ends before its list of pages tifffile only logs it."""
    with _kept_log() as words:
        pages = len(tiff.pages)
    if any("invalid page offset" in word for word in words):
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
    """Hold the sizes against the file; refuse a compression that can't be undone."""
    first, size = tiff.pages.first, path.stat().st_size
    if first.compression not in _READ:
        name = getattr(first.compression, "name", first.compression)
        raise ScanFileError(
            f"{path}: is compressed by {name}, which isn't read; export it uncompressed, or by "
            "Deflate (zip) or PackBits"
        )
    if first.bitspersample not in (1, 8, 16, 32, 64) or first.fillorder != 1:
        order = "" if first.fillorder == 1 else ", the lowest first (FillOrder 2)"
        raise ScanFileError(
            f"{path}: stores {first.bitspersample} bits a pixel{order}, which isn't read; export "
            "it with 8 or 16, the highest first"
        )
    bounds = {1: 1, **dict.fromkeys(_DEFLATE, DEFLATE_RATIO)}
    # Samples of less than a byte are packed, eight bits of them a byte.
    packed = 8 * np.dtype(first.dtype).itemsize / min(first.bitspersample, 8)
    bound = math.ceil(max(packed, 1) * bounds.get(first.compression, ANY_RATIO))
    check_available(shape, first.dtype, size * bound, path)


def _known(tiff: tifffile.TiffFile, path: Path) -> tuple[dict[str, object], tuple[str, ...]]:
    """What the file says of itself, and what the user should know of it."""
    text = tiff.pages.first.description
    if SCHEMA in text:
        return {"axes": "zyx", **parse(text, str(path))}, ()
    if tiff.is_ome and tiff.ome_metadata:
        return read_ome_xml(tiff.ome_metadata, path)
    if tiff.is_imagej:
        return _of_imagej(tiff)
    return {}, ()


def _of_imagej(tiff: tifffile.TiffFile) -> tuple[dict[str, object], tuple[str, ...]]:
    """ImageJ: slices are z; spacing and units in its own text, pixels by the resolution tags.

    ``unit`` is that of all axes for which there is no ``yunit`` or ``zunit``.
    """
    metadata = tiff.imagej_metadata or {}
    tags = tiff.pages.first.tags
    every = str(metadata.get("unit", ""))
    units = [str(metadata.get(key) or every) for key in ("zunit", "yunit")] + [every]
    if "YResolution" not in tags:
        return {"axes": "zyx"}, ()
    across, down = (tags[name].value for name in ("XResolution", "YResolution"))
    pixel = [per[0] and per[1] / per[0] for per in (down, across)]
    known, notes = known_voxel([abs(float(metadata.get("spacing", 0))), *pixel], units)
    if not known:
        return {"axes": "zyx"}, notes
    deep, high, wide = known["voxel_mm"]
    if max(wide, high) > _MAX_ASPECT * min(wide, high):
        # Programs that give the text a yunit may leave the tag in the unit of all axes.
        known_high = pixel[0] * (millimetres(every) or 0.0)
        notes = (
            f"its text says pixels of {wide:g} × {high:g} mm (unit, yunit), which can't be: they "
            f"are taken as {wide:g} × {known_high:g} mm; if that is wrong give --voxel-um",
        )
        high = known_high
    return {"axes": "zyx", "voxel_mm": [deep, high, wide]}, notes


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
