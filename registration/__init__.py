"""Scan to report: read, segment, align, gauge."""

from registration.errors import RegistrationError
from registration.options import RegistrationOptions
from registration.readers import ScanOverrides, read_scan, write_scan_tiff
from registration.register import register_scan
from registration.result import RegistrationReport, report_dict
from registration.scan import Scan

__all__ = [
    "RegistrationError",
    "RegistrationOptions",
    "RegistrationReport",
    "Scan",
    "ScanOverrides",
    "read_scan",
    "register_scan",
    "report_dict",
    "write_scan_tiff",
]
