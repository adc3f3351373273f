"""Read processed intensity from a Thorlabs ``.oct`` zip archive."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import (
    MOST_XML_BYTES,
    FileVolume,
    bytes_of,
    member_array,
    parse_xml,
    scan_file_errors,
)
from registration.files.readers.metadata import check_aspect, parse

HEADER, INTENSITY, OURS = "header.xml", "data/intensity.data", "PrintctlScan"
_DTYPES: dict[int, np.dtype[Any]] = {4: np.dtype("<f4"), 2: np.dtype("<i2")}
_FASTEST_FIRST = "ZXY"


def _plain(element: Element) -> str:
    return (element.text or "").strip().replace("\\", "/").lower()


@dataclass(frozen=True)
class _Sizes:
    """By axis letter: voxels, spacing in mm, extent in mm (None where the header is silent)."""

    voxels: dict[str, int]
    spacing: dict[str, float] | None
    extent: dict[str, float] | None


def is_thorlabs(archive: zipfile.ZipFile) -> bool:
    """Whether a zip archive is a Thorlabs file."""
    return any(plain_name(info) == HEADER for info in archive.infolist())


def plain_name(info: zipfile.ZipInfo) -> str:
    """A member's name in lower case with plain slashes; only compared, never used as a path."""
    return info.filename.replace("\\", "/").lower()


def read_thorlabs(path: Path) -> FileVolume:
    """The processed intensity of a ``.oct`` file.

    Raises
    ------
    ScanFileError
        When the archive is broken, its sizes contradict each other, or it holds no volume.
    """
    with scan_file_errors(path, "archive"), zipfile.ZipFile(path) as archive:
        members = {plain_name(info): info for info in archive.infolist()}
        root = _header(archive, members[HEADER], path)
        data = members.get(INTENSITY)
        if data is None:
            raise ScanFileError(
                f"{path}: holds no processed intensity, only {', '.join(sorted(members))}; "
                "store processed data as well (ThorImage: storage format)"
            )
        return _read(archive, data, root, path)


def _header(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path) -> Element:
    with archive.open(info) as handle:
        return parse_xml(handle.read(MOST_XML_BYTES + 1), f"{path}: {info.filename}")


def _read(archive: zipfile.ZipFile, data: zipfile.ZipInfo, root: Element, path: Path) -> FileVolume:
    sizes, stored = _sizes(root, path)
    order = _axis_order(root, path)
    slowest_first = order[::-1].lower()
    shape = tuple(sizes.voxels[name] for name in order[::-1])
    dtype = _dtype(shape, stored, data.file_size, path)
    volume = member_array(archive, data, dtype, shape, path)
    known: dict[str, object] = {"axes": slowest_first, "modality": "oct", "depth_down": True}
    if dtype.itemsize == 4:
        known["scale"] = "db"
    known |= _depth(root, path)
    known |= _voxel(sizes, path)
    ours = root.find(f".//{{*}}{OURS}")
    if ours is not None and ours.text:
        known |= parse(ours.text, f"{path}: {OURS}") | {"axes": slowest_first}
    return FileVolume(volume, known)


def _sizes(root: Element, path: Path) -> tuple[_Sizes, Element | None]:
    """Sizes of the image, held against those of the stored array."""
    stored = next((e for e in root.iter() if _plain(e) == INTENSITY), None)
    voxels = _three(root.find(".//{*}SizePixel"), path)
    of_array = _attributes(stored, "Size", path) if stored is not None else None
    counts = voxels or of_array
    if counts is None:
        raise ScanFileError(f"{path}: Header.xml says no SizePixel; export it again")
    whole = {name: round(value) for name, value in counts.items()}
    if of_array is not None and whole != {name: round(v) for name, v in of_array.items()}:
        raise ScanFileError(
            f"{path}: the image is {_text(whole)} voxels but its array {_text(of_array)}; the "
            "axes were swapped or the header is broken: export it again"
        )
    if whole["Y"] < 2 or whole["X"] < 2:
        raise ScanFileError(f"{path}: one B-scan ({_text(whole)}), not a volume; scan in 3D mode")
    extent = _three(root.find(".//{*}SizeReal"), path)
    if extent is None and stored is not None:
        extent = _attributes(stored, "Range", path)
    return _Sizes(whole, _three(root.find(".//{*}PixelSpacing"), path), extent), stored


def _three(parent: Element | None, path: Path) -> dict[str, float] | None:
    """``SizeZ``, ``SizeX``, ``SizeY`` below an element."""
    if parent is None:
        return None
    texts = {name: parent.findtext(f"{{*}}Size{name}") for name in "ZXY"}
    return _numbers({name: text for name, text in texts.items() if text}, path)


def _attributes(element: Element, prefix: str, path: Path) -> dict[str, float] | None:
    texts = {name: element.get(prefix + name) for name in "ZXY"}
    return _numbers({name: text for name, text in texts.items() if text}, path)


def _numbers(texts: dict[str, str], path: Path) -> dict[str, float] | None:
    if set(texts) < {"Z", "X"}:
        return None
    try:
        numbers = {name: float(text) for name, text in texts.items()}
    except ValueError as exc:
        raise ScanFileError(f"{path}: Header.xml has a size that is no number ({exc})") from exc
    if not all(0 < value < 1e9 for value in numbers.values()):
        raise ScanFileError(f"{path}: Header.xml says sizes of {_text(numbers)}; export it again")
    return {"Y": 1.0, **numbers}


def _axis_order(root: Element, path: Path) -> str:
    text = (root.findtext(".//{*}AxisOrder") or _FASTEST_FIRST).strip().upper()
    # ThorImage 5 names the time of a series last; one volume has one.
    text = text.removesuffix("T")
    if sorted(text) != ["X", "Y", "Z"]:
        raise ScanFileError(
            f"{path}: AxisOrder is {text!r}, not an order of X, Y and Z; export it again"
        )
    return text


def _dtype(
    shape: tuple[int, ...], stored: Element | None, available: int, path: Path
) -> np.dtype[np.generic]:
    """Type of the array: as the header says, and as the member's size says."""
    stated = stored.get("BytesPerPixel") if stored is not None else None
    for width, dtype in _DTYPES.items():
        if bytes_of(shape, dtype, path) == available and stated in (None, str(width)):
            return dtype
    raise ScanFileError(
        f"{path}: {INTENSITY} holds {available} bytes, but {' × '.join(map(str, shape))} voxels "
        f"take {bytes_of(shape, _DTYPES[4], path)} as float32 or half of it as int16 (header: "
        f"{stated or 'no'} BytesPerPixel); its sizes are wrong or it is truncated: export it again"
    )


def _depth(root: Element, path: Path) -> dict[str, object]:
    """Whether depth is optical, and the index it was divided by."""
    text = root.findtext(".//{*}RefractiveIndex")
    if text is None:
        return {}
    try:
        index = float(text)
    except ValueError as exc:
        raise ScanFileError(f"{path}: RefractiveIndex is {text!r}; export it again") from exc
    if index == 1.0:
        return {"optical_depth": True}
    return {"optical_depth": False, "refractive_index": index}


def _voxel(sizes: _Sizes, path: Path) -> dict[str, object]:
    counts = [sizes.voxels[name] for name in "ZYX"]
    extent = None if sizes.extent is None else [sizes.extent[name] for name in "ZYX"]
    if sizes.spacing is not None:
        voxel = [sizes.spacing[name] for name in "ZYX"]
        if extent is not None:
            check_aspect(counts, voxel, extent, path)
        return {"voxel_mm": voxel}
    if extent is not None:
        return {"voxel_mm": [size / count for size, count in zip(extent, counts, strict=True)]}
    return {}


def _text(sizes: dict[str, float] | dict[str, int]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in sorted(sizes.items()))
