"""What scripts and notebooks use to register a scan: `import registration` hands it on.

It stays as it is from one minor version to the next; what isn't named here may move. docs/python.md
shows it at work.
"""

from registration.errors import RegistrationError
from registration.exports import vessel_rows, write_tables
from registration.options import RegistrationOptions
from registration.readers import ScanOverrides, read_scan, write_scan_tiff
from registration.register import register_scan
from registration.report.alone import write_report
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
    "vessel_rows",
    "write_report",
    "write_scan_tiff",
    "write_tables",
]
