"""Turn a calibrated camera's pictures of a swept laser line into heights.

Goes in: a folder of pictures, a TIFF of pages or a video, and the camera's frame. Comes out: the
point that all planes of the laser's light share (from one sweep over a flat face), and by it points
x, y, z of later sweeps. Begin with `profiles.py`.
"""

from registration.devices.laser_sweep.heights import sweep_heights
from registration.devices.laser_sweep.planes import (
    FittedSweep,
    fit_laser,
    is_laser_file,
    read_laser,
)
from registration.devices.laser_sweep.profiles import trace

__all__ = [
    "FittedSweep",
    "fit_laser",
    "is_laser_file",
    "read_laser",
    "sweep_heights",
    "trace",
]
