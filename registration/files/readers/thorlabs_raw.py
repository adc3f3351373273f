r"""Compute linear intensity from the raw spectra of a Thorlabs ``.oct`` without processed data.

One member ``data\SpectralN.data`` for each B-scan: A-scans of SizeZ samples of 16 bit, SizeX of
them, among which the header's ApoRegion (without sample, for the background) and ScanRegion.
``data\Chirp.data``, float32: each sample's place on an even scale of wavenumber. Source: Thorlabs'
own ``OCTFileGetRawData.m`` and ``OCTFileGetChirp.m``, and two public readers that process them
(T. Meissner; "OCT_reader"), which agree. The file gives no dispersion: none is taken out.

Not verified on a device's file. Refused: several spectra for an A-scan, A-scans or B-scans for
one of the volume, two cameras.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.files.readers.fourier import Floats, Spectrometer, profiles
from registration.files.readers.raw_result import Array
from registration.files.readers.storage import fill_volume
from registration.files.readers.zipped import member_array

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


def _chirp(archive: zipfile.ZipFile, members: Members, samples: int, path: Path) -> Floats:
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
