"""Exports for other programs: tables (CSV), surfaces and axes (VTP), volumes (NRRD).

Goes in: a registration. Comes out: files. Begin with `tables.py`.
"""

from registration.files.exports.nrrd import nrrd_header, write_scan_nrrd
from registration.files.exports.tables import vessel_rows, write_tables
from registration.files.exports.vtp import write_axes_vtp, write_surface_vtp

__all__ = [
    "nrrd_header",
    "vessel_rows",
    "write_axes_vtp",
    "write_scan_nrrd",
    "write_surface_vtp",
    "write_tables",
]
