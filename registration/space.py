"""Name of a scan file's coordinate space, and the matrix from the scan's frame to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Space:
    """The file's own right-handed space, and where the scan's frame lies in it.

    Attributes
    ----------
    name : str
        "LPS" for patient coordinates (x left, y posterior, z superior, as DICOM has them), else
        words of the file's own.
    from_scan : (4, 4) float64, mm
        Takes a point x, y, z of the scan's frame to the space: a rotation and a shift. Depth
        counts as in the file (`Scan.voxel_mm`, optical where `Scan.optical_depth`).
    """

    name: str
    from_scan: NDArray[np.float64]
