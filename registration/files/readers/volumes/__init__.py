"""Readers of general volume formats (TIFF, DICOM, NIfTI, NRRD, Zarr…), one a file.

Goes in: a scan file. Comes out: a `Scan`. Begin with `tiff.py`.
"""
