"""Scan files: read by content, and written for the simulated scanner."""

from registration.readers.metadata import ScanOverrides
from registration.readers.read import read_scan
from registration.readers.tiff import write_scan_tiff

__all__ = ["ScanOverrides", "read_scan", "write_scan_tiff"]
