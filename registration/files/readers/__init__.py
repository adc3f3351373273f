"""Read scan files of any known format, recognised by content, and mosaics; write TIFF.

Goes in: a file or folder, and what the user states of it. Comes out: a `Scan`. Begin with
`read.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.files.readers.metadata import ScanOverrides
    from registration.files.readers.mosaic import is_mosaic, listed_files, read_mosaic
    from registration.files.readers.read import read_scan
    from registration.files.readers.volumes.tiff import write_scan_tiff

__all__ = [
    "ScanOverrides",
    "is_mosaic",
    "listed_files",
    "read_mosaic",
    "read_scan",
    "write_scan_tiff",
]

__getattr__, __dir__ = on_demand(__name__)
