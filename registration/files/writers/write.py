"""Write a scan; the format is chosen by the file name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from registration.errors import RegistrationError
from registration.files.readers.tiff import write_scan_tiff
from registration.files.writers.ome_zarr import write_scan_zarr
from registration.files.writers.thorlabs import write_scan_oct
from registration.scan import Scan

_WRITERS: dict[str, Callable[[Path, Scan], None]] = {
    ".tif": write_scan_tiff,
    ".tiff": write_scan_tiff,
    ".oct": write_scan_oct,
    ".zarr": write_scan_zarr,
}


def write_scan(path: Path, scan: Scan) -> None:
    """Write a scan as ``.tif``, ``.oct`` or ``.zarr`` (OME-Zarr, a folder).

    Raises
    ------
    RegistrationError
        When the suffix is none of these, or the format can't hold the scan.
    OSError
        When the disk is full or the folder can't be written.
    """
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise RegistrationError(f"{path}: scans are written as {', '.join(_WRITERS)}; name it so")
    writer(path, scan)
