"""Calibrate an OCT device, and correct its scans for fan, bow, depth scale and refraction.

Goes in: scans of a dot grid and a step. Comes out: a calibration file, and corrected scans. Begin
with `beam.py`.
"""

from registration.devices.optics.beam import Beam, OctCalibration, refract, refraction_bound
from registration.devices.optics.file import read_calibration, write_calibration
from registration.devices.optics.fit import fit_grid, with_step
from registration.devices.optics.surface import SampleSurface, find_surface
from registration.devices.optics.targets import GridView, find_grid, measure_step
from registration.devices.optics.undistort import is_resampled, undistort

__all__ = [
    "Beam",
    "GridView",
    "OctCalibration",
    "SampleSurface",
    "find_grid",
    "find_surface",
    "fit_grid",
    "is_resampled",
    "measure_step",
    "read_calibration",
    "refract",
    "refraction_bound",
    "undistort",
    "with_step",
    "write_calibration",
]
