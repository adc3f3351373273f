"""Read processed intensity, or raw spectra, from a Thorlabs ``.oct`` zip archive."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.errors import ScanFileError
from registration.files.readers.common import (
    MOST_XML_BYTES,
    Array,
    FileVolume,
    bytes_of,
    fill_volume,
    member_array,
    parse_xml,
    scan_file_errors,
)
from registration.files.readers.fourier import Spectrometer, profiles
from registration.files.readers.metadata import check_aspect, parse

# Compute linear intensity from the raw spectra of a Thorlabs ``.oct`` without processed data.
#
# One member ``data\SpectralN.data`` for each B-scan: A-scans of SizeZ samples of 16 bit, SizeX of
# them, among which the header's ApoRegion (without sample, for the background) and ScanRegion.
# ``data\Chirp.data``, float32: each sample's place on an even scale of wavenumber. Source:
# Thorlabs' own ``OCTFileGetRawData.m`` and ``OCTFileGetChirp.m``, and two public readers that
# process them (T. Meissner; "OCT_reader"), which agree. The file gives no dispersion: none is taken
# out.
#
# Not verified on a device's file. Refused: several spectra for an A-scan, A-scans or B-scans for
# one of the volume, two cameras.

FIRST, CHIRP = "data/spectral0.data", "data/chirp.data"
NOTE = (
    "made from raw spectra (Thorlabs; not verified on a device's file): background by the "
    "apodization lines, wavenumbers by the chirp, Hann window, no dispersion taken out"
)
_AVERAGES = (
    "IntensityAveraging/Spectra", "IntensityAveraging/AScans", "IntensityAveraging/BScans",
    "SpeckleAveraging/FastAxis", "SpeckleAveraging/SlowAxis",
)  # fmt: skip
_LEAST, _MOST = 64, 16384
_SECOND = "data/chirp_cam1.data"
Members = Mapping[str, zipfile.ZipInfo]


def intensity_of_spectra(
    archive: zipfile.ZipFile, members: Members, root: Element, voxels: Mapping[str, int], path: Path
) -> Array:
    """Linear intensity, axes y, x, z, of a file's raw spectra.

    Raises
    ------
    ScanFileError
        When spectra are averaged, a member is missing, or sizes contradict each other.
    """
    _check_single(root, members, path)
    about = next((e for e in root.findall(".//{*}DataFile") if _plain(e) == FIRST), None)
    if about is None:
        raise ScanFileError(f"{path}: Header.xml doesn't describe Spectral0; export it again")
    samples, lines = _whole(about, "SizeZ", path), _whole(about, "SizeX", path)
    dark, scanned = _region(about, "Apo", lines, path), _region(about, "Scan", lines, path)
    if voxels["Z"] != samples // 2 or voxels["X"] != scanned.stop - scanned.start:
        raise ScanFileError(
            f"{path}: spectra of {samples} samples and {scanned.stop - scanned.start} A-scans make "
            f"{samples // 2} depths, but the image is Z {voxels['Z']}, X {voxels['X']}; export "
            "processed data"
        )
    place = _chirp(archive, members, samples, path)
    signed = (root.findtext(".//{*}RawDataIsSigned") or "False").strip().lower() == "true"
    kind, shape = np.dtype("<i2" if signed else "<u2"), (lines, samples)

    if not _LEAST <= samples <= _MOST:
        raise ScanFileError(f"{path}: spectra of {samples} samples (limits {_LEAST}, {_MOST})")
    missing = [n for n in range(voxels["Y"]) if f"data/spectral{n}.data" not in members]
    if missing:
        raise ScanFileError(
            f"{path}: Spectral{missing[0]} of {voxels['Y']} B-scans is missing; copy it again"
        )

    def made() -> Iterator[NDArray[np.float32]]:
        kernel = Spectrometer(place).kernel()
        for index in range(voxels["Y"]):
            member = members[f"data/spectral{index}.data"]
            counts = member_array(archive, member, kind, shape, path).astype(np.float64)
            yield profiles(counts[scanned] - counts[dark].mean(axis=0), kernel)

    out = (voxels["Y"], voxels["X"], voxels["Z"])
    return fill_volume(made(), out, np.dtype(np.float32), path)


def _check_single(root: Element, members: Members, path: Path) -> None:
    for name in _AVERAGES:
        parent, child = name.split("/")
        text = root.findtext(f".//{{*}}{parent}/{{*}}{child}") or "1"
        if text.strip() != "1":
            raise ScanFileError(
                f"{path}: its raw spectra are to be averaged ({name} {text.strip()}), which isn't "
                "read; export processed data"
            )
    if _SECOND in members:
        raise ScanFileError(f"{path}: raw spectra of two cameras; export processed data")


def _region(about: Element, name: str, lines: int, path: Path) -> slice:
    start, end = (_whole(about, f"{name}Region{side}0", path) for side in ("Start", "End"))
    if not 0 <= start < end <= lines:
        raise ScanFileError(
            f"{path}: {name}Region from {start} to {end} of {lines} lines; export processed data"
        )
    return slice(start, end)


def _chirp(archive: zipfile.ZipFile, members: Members, samples: int, path: Path) -> FloatArray:
    if CHIRP not in members:
        raise ScanFileError(f"{path}: raw spectra without Chirp.data; export processed data")
    values = member_array(archive, members[CHIRP], np.dtype("<f4"), (1, 1, samples), path)
    place = np.asarray(values, dtype=np.float64).ravel()
    if not ((np.diff(place) > 0).all() and place[0] >= -1 and place[-1] <= samples):
        raise ScanFileError(
            f"{path}: its chirp runs from {place[0]:g} to {place[-1]:g} (needed: rising, within 0 "
            f"to {samples - 1}); export processed data"
        )
    return place


def _plain(element: Element) -> str:
    return (element.text or "").strip().replace("\\", "/").lower()


def _whole(element: Element, name: str, path: Path) -> int:
    text: Any = element.get(name)
    try:
        return int(text)
    except (TypeError, ValueError) as exc:
        raise ScanFileError(f"{path}: Spectral0 says {name} {text!r}; export it again") from exc


HEADER, INTENSITY, OURS = "header.xml", "data/intensity.data", "PrintctlScan"
_DTYPES: dict[int, np.dtype[Any]] = {4: np.dtype("<f4"), 2: np.dtype("<i2")}
_FASTEST_FIRST = "ZXY"


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
        if data is None and FIRST in members:
            return _read_spectra(archive, members, root, path)
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
    known: dict[str, Any] = {"axes": slowest_first, "modality": "oct", "depth_down": True}
    if dtype.itemsize == 4:
        known["scale"] = "db"
    known |= _depth(root, path)
    known |= _voxel(sizes, path)
    ours = root.find(f".//{{*}}{OURS}")
    if ours is not None and ours.text:
        known |= parse(ours.text, f"{path}: {OURS}") | {"axes": slowest_first}
    return FileVolume(volume, known)


def _read_spectra(
    archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo], root: Element, path: Path
) -> FileVolume:
    """The volume that raw spectra make, sizes as in the header."""
    sizes, _ = _sizes(root, path)
    volume = intensity_of_spectra(archive, members, root, sizes.voxels, path)
    known = {"axes": "yxz", "modality": "oct", "depth_down": True, "scale": "linear"}
    return FileVolume(volume, known | _depth(root, path) | _voxel(sizes, path), notes=(NOTE,))


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


def _depth(root: Element, path: Path) -> dict[str, Any]:
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


def _voxel(sizes: _Sizes, path: Path) -> dict[str, Any]:
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
