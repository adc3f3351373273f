"""Read a scan; the format is recognised by the first bytes, or by a folder's contents."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from registration.errors import ScanFileError
from registration.files.readers.common import FileVolume
from registration.files.readers.metadata import (
    RAW_KEYS,
    ScanOverrides,
    build_scan,
    find_sidecar,
    sidecar,
)
from registration.files.readers.vendors import bioptigen, heidelberg, thorlabs
from registration.files.readers.volumes import (
    dicom,
    hdf5,
    matlab,
    metaimage,
    nifti,
    npz,
    nrrd,
    raw,
    tiff,
    zarr,
)
from registration.scan import Scan

Reader = Callable[[Path], FileVolume]

_START_BYTES = 512
_ZIP = b"PK"
_GZIP = b"\x1f\x8b"
_REFUSED = {
    b"CMDb": "a Heidelberg .e2e file, whose layout isn't published; export it as .vol (raw)",
    b"FOCT": "a Topcon .fda file, whose layout isn't published; export it as DICOM",
}
"""Files that are known by their first bytes and not read."""

_HDF5_PLACES = (0, 512)
"""MATLAB 7.3 puts HDF5 behind 512 bytes of its own."""


def read_scan(
    path: Path, overrides: ScanOverrides | None = None, *, keep_counts: bool = False
) -> Scan:
    """Read a scan of any known format.

    `keep_counts`: leave counts that stand for dB as they are (`Scan.counts`): a quarter of the
    memory.

    Units and kin come from the file, from ``NAME.json`` or ``NAME.yaml`` beside it, or from
    `overrides`, the later over the earlier; nothing is guessed.

    Raises
    ------
    ScanFileError
        When the file is missing, of no known format, broken, or doesn't say what it must.
    """
    reader = recognise(path)
    # A TIFF's or npz's axes are its own; a raw file's sidecar has been used up by then.
    more = RAW_KEYS if reader is raw.read_raw else ()
    volume = reader(path)
    metadata = {k: v for k, v in sidecar(path, more).items() if k not in RAW_KEYS}
    return build_scan(volume, metadata, overrides or ScanOverrides(), path, keep_counts)


def recognise(path: Path) -> Reader:
    """Return the reader of a scan, by its first bytes or a folder's contents.

    Raises
    ------
    ScanFileError
        When the file is missing, empty, of no known format or of one that isn't read.
    """
    if path.is_dir():
        return _folder_reader(path)
    if not path.is_file():
        raise ScanFileError(f"{path}: no such scan; check the path")
    with path.open("rb") as handle:
        start = handle.read(_START_BYTES + len(hdf5.MAGIC))
    if not start:
        raise ScanFileError(f"{path}: is empty; was the disk full, or the device still writing?")
    reader = _by_start(path, start)
    if reader is not None:
        return reader
    for mark, what in _REFUSED.items():
        if start.startswith(mark):
            raise ScanFileError(f"{path}: {what}")
    if find_sidecar(path) is not None:
        return raw.read_raw
    raise ScanFileError(
        f"{path}: of no known format by its first bytes ({start[:4].hex(' ')}); export the scan "
        "as a TIFF stack, or give a raw file a sidecar that says its shape and dtype"
    )


def _by_start(path: Path, start: bytes) -> Reader | None:
    # First, as its preamble of 128 bytes may look like any other format.
    if start[128:132] == dicom.MAGIC:
        return dicom.read_dicom
    if start[:4] in tiff.MAGIC:
        return tiff.read_tiff
    if start[:2] == _ZIP:
        return _zip_reader(path)
    if start.startswith(heidelberg.MAGIC):
        return heidelberg.read_heidelberg
    if bioptigen.is_bioptigen(start):
        return bioptigen.read_bioptigen
    if start.startswith(nrrd.MAGIC):
        return nrrd.read_nrrd
    if metaimage.is_metaimage(start):
        return metaimage.read_metaimage
    if start.startswith(_GZIP):
        start = _unzipped(path)
    if nifti.is_nifti(start):
        return nifti.read_nifti
    if start[128:132] == dicom.MAGIC:  # within a gzip file
        return dicom.read_dicom
    if any(start[at : at + len(hdf5.MAGIC)] == hdf5.MAGIC for at in _HDF5_PLACES):
        return hdf5.read_hdf5
    if start.startswith(matlab.MAGIC):
        return matlab.read_matlab
    return None


def _zip_reader(path: Path) -> Reader:
    try:
        with zipfile.ZipFile(path) as archive:
            return thorlabs.read_thorlabs if thorlabs.is_thorlabs(archive) else npz.read_npz
    except (zipfile.BadZipFile, NotImplementedError) as exc:
        raise ScanFileError(f"{path}: broken archive ({exc}); copy it again") from exc


def _folder_reader(path: Path) -> Reader:
    if zarr.is_zarr(path):
        return zarr.read_zarr
    if any(place.is_file() and dicom.is_dicom(place) for place in path.iterdir()):
        return dicom.read_dicom_folder
    if tiff.has_slices(path):
        return tiff.read_tiff_folder
    raise ScanFileError(
        f"{path}: a folder of neither OME-Zarr nor DICOM or numbered TIFF slices; give one, or the "
        "scan's file"
    )


def _unzipped(path: Path) -> bytes:
    """The first bytes of what a gzip file holds."""
    try:
        with gzip.open(path) as handle:
            return handle.read(_START_BYTES)
    except (OSError, EOFError, zlib.error) as exc:
        raise ScanFileError(f"{path}: broken gzip ({exc}); copy it again") from exc
