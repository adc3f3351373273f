"""Measure a print (scan, dye video, picture) against its design: align, gauge, judge, report.

`import registration` gives what scripts and notebooks use, and docs/python.md shows. These names
stay as they are from one minor version to the next; what isn't named here may move. Each is loaded
when it is first asked for: a command that needs one room shouldn't wait for all.

Goes in: a scan file and a design. Comes out: a `RegistrationReport`, pages and exports. Begin with
`register.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.errors import RegistrationError
    from registration.files.exports import vessel_rows, write_tables
    from registration.files.readers import ScanOverrides, read_scan, write_scan_tiff
    from registration.options import RegistrationOptions
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
    "vessel_rows",
    "write_scan_tiff",
    "write_tables",
]

__getattr__, __dir__ = on_demand(__name__)
