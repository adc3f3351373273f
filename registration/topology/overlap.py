"""Compute the volume overlap of designed and printed lumens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.topology.grid import LumenGrid


@dataclass(frozen=True)
class Overlap:
    """Volumes of the lumens in the field of view.

    Attributes
    ----------
    dice : float
        Twice the common volume over the sum of both (Dice 1945, doi 10.2307/1932409).
    volume_ratio : float
        Printed over designed.
    printed_mm3, designed_mm3 : float, mm³
        By counting voxels; printed is what is free within `near_mm` of a designed wall.
    near_mm : float, mm
    """

    dice: float
    volume_ratio: float
    printed_mm3: float
    designed_mm3: float
    near_mm: float


def overlap(grid: LumenGrid, near_mm: float) -> Overlap:
    """Compare volumes on a grid; NaN where nothing of the design is in view.

    Parameters
    ----------
    grid : LumenGrid
    near_mm : float, mm
        Free space farther from the designed wall is no lumen of this design (but a leak, say).
    """
    designed = grid.known & (grid.wall_mm <= 0)
    printed = grid.known & grid.free & (grid.wall_mm <= near_mm)
    both = int(np.count_nonzero(designed & printed))
    a, b = int(np.count_nonzero(printed)), int(np.count_nonzero(designed))
    cell = grid.step_mm**3
    return Overlap(
        dice=2 * both / (a + b) if a + b else float("nan"),
        volume_ratio=a / b if b else float("nan"),
        printed_mm3=a * cell,
        designed_mm3=b * cell,
        near_mm=near_mm,
    )
