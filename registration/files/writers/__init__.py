"""Write a scan to a file: Thorlabs ``.oct``, OME-Zarr or TIFF.

Goes in: a `Scan`. Comes out: a file. Begin with `write.py`.
"""

from registration.files.writers.ome_zarr import write_scan_zarr
from registration.files.writers.thorlabs import write_scan_oct
from registration.files.writers.write import write_scan

__all__ = ["write_scan", "write_scan_oct", "write_scan_zarr"]
