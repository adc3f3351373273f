"""Scan files: read by content, whatever they are called."""

from registration.readers.metadata import ScanOverrides
from registration.readers.mosaic import is_mosaic, listed_files, read_mosaic
from registration.readers.read import read_scan
from registration.readers.tiff import write_scan_tiff

__all__ = [
    "ScanOverrides",
    "is_mosaic",
    "listed_files",
    "read_mosaic",
    "read_scan",
    "write_scan_tiff",
]
