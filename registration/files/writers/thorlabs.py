r"""Write a scan as Thorlabs ``.oct`` in ThorImage's layout: a zip of a header and raw data.

Intensity is float32 in dB, depth fastest, then x, then y, uncompressed, so that it can be mapped.
What Thorlabs' header has no place for stands in one element of ours, which others skip.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import IO
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import NDArray

from design.files import atomic_replacement
from registration.errors import RegistrationError
from registration.files.readers.metadata import describe
from registration.files.readers.thorlabs import OURS
from registration.scan import Scan

_DATE = (1980, 1, 1, 0, 0, 0)
"""Same scan, same bytes."""

_LEAST = np.float32(0.5)
"""Half a count: zero has no decibels."""

_MEMBER = "data\\Intensity.data"


def write_scan_oct(path: Path, scan: Scan) -> None:
    """Write an OCT scan as a ``.oct`` file; linear intensity becomes 10 log10 of it.

    Raises
    ------
    RegistrationError
        When the scan isn't OCT.
    OSError
        When the disk is full or the folder can't be written.
    """
    if scan.modality != "oct":
        raise RegistrationError(
            f"{path}: a .oct file holds OCT, not {scan.modality}; write a TIFF or OME-Zarr"
        )
    with (
        atomic_replacement(path) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_STORED) as archive,
    ):
        archive.writestr(_entry("Header.xml"), tostring(_header(scan), encoding="utf-8"))
        with archive.open(_entry(_MEMBER), "w", force_zip64=True) as handle:
            _write_intensity(handle, scan)


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo("x", _DATE)
    entry.filename = name  # as it stands: on Windows the constructor would turn backslashes
    return entry


def _write_intensity(handle: IO[bytes], scan: Scan) -> None:
    """B-scans in order, each turned so that depth runs fastest."""
    for y in range(scan.volume.shape[1]):
        handle.write(_decibels(scan.volume[:, y, :], scan.scale).T.tobytes())


def _decibels(values: NDArray[np.generic], scale: str) -> NDArray[np.float32]:
    plain = values.astype("<f4")
    if scale == "db":
        return plain
    return np.float32(10) * np.log10(np.maximum(plain, _LEAST))


def _header(scan: Scan) -> Element:
    counts = dict(zip("ZYX", scan.volume.shape, strict=True))
    # With RefractiveIndex 1 a Thorlabs header's depth is optical, else it has been divided.
    spacing = dict(zip("ZYX", scan.voxel_mm, strict=True))
    index = 1.0 if scan.optical_depth else scan.refractive_index
    root = Element("Ocity")
    SubElement(SubElement(root, "MetaInfo"), "AcquisitionMode").text = "Mode3D"
    SubElement(SubElement(root, "Acquisition"), "RefractiveIndex").text = repr(index)
    image = SubElement(root, "Image", Type="Processed")
    rows = {
        "SizePixel": counts,
        "SizeReal": {name: counts[name] * spacing[name] for name in "ZXY"},
        "PixelSpacing": spacing,
    }
    for name, values in rows.items():
        row = SubElement(image, name)
        for axis in "ZXY":
            SubElement(row, f"Size{axis}").text = repr(values[axis])
    about = {"Type": "Real", "BytesPerPixel": "4"}
    about |= {f"Size{axis}": str(counts[axis]) for axis in "ZXY"}
    about |= {f"Range{axis}": repr(counts[axis] * spacing[axis]) for axis in "ZXY"}
    stored = SubElement(SubElement(root, "DataFiles"), "DataFile", about)
    stored.text = _MEMBER
    ours = {**scan.__dict__, "scale": "db"}
    SubElement(root, OURS).text = describe(Scan(**ours))
    return root
