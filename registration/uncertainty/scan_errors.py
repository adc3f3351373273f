"""Errors that all measurements of one scan share: walls, depth, lateral scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.scan import Scan
from registration.uncertainty.budget import rectangular
from registration.walls_file import WallCalibration

FloatArray = NDArray[np.float64]

INDEX_HALF_WIDTH = 0.02
"""Of the group index without a depth standard: hydrogels and media lie within ± 2 % of water."""
LATERAL_HALF_WIDTH = 0.0005
"""Of the lateral voxel size as a file states it (its last digit); a scanner's own error, which no
scan shows, comes with `--oct-calibration`."""
WALL_PART = 0.2
"""Standard uncertainty of a wall's place without an estimate of its own, as part of the blur."""
BLUR_PART = 0.1
"""Relative standard uncertainty of the blur."""


@dataclass(frozen=True)
class ScanErrors:
    """Standard uncertainties common to a whole scan.

    Attributes
    ----------
    wall_mm : float, mm
        Of the place of a wall, the same all round.
    wall_dof : float
        Degrees of freedom of `wall_mm`.
    depth, lateral : float
        Relative, of lengths along and across the light.
    blur_mm : float, mm
        Blur under which walls were found.
    beam : (3,) float64
        Unit vector of the light's way, in the scan's frame.
    """

    wall_mm: float
    wall_dof: float
    depth: float
    lateral: float
    blur_mm: float
    beam: FloatArray


def scan_errors(scan: Scan, blur_mm: float, walls: WallCalibration | None = None) -> ScanErrors:
    """Return what is known of a scan's shared errors before any wall is looked at."""
    oct_ = scan.modality == "oct"
    known = scan.depth_standard or not oct_
    wall = WALL_PART * blur_mm if walls is None else 1e-3 * walls.interval_um / 1.96
    return ScanErrors(
        wall_mm=wall,
        wall_dof=50.0,
        depth=rectangular(LATERAL_HALF_WIDTH if known else INDEX_HALF_WIDTH),
        lateral=rectangular(LATERAL_HALF_WIDTH),
        blur_mm=blur_mm,
        beam=np.array([0.0, 0.0, 1.0]),
    )
