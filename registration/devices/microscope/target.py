"""Records of the calibration pattern to find in a picture, and of its found position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Target:
    """What is looked for, in the pattern's own frame, y up.

    Attributes
    ----------
    size_mm : (x, y), mm
        Of the frame.
    width_mm : float, mm
        Of its lines, about.
    margin_mm : float, mm
        Between the frame and all else.
    points : (n, 2) float64, mm
        Along everything that is written.
    """

    size_mm: tuple[float, float]
    width_mm: float
    margin_mm: float
    points: FloatArray

    @property
    def sides(self) -> list[FloatArray]:
        """Left, bottom, right half, top half: begin and end, (2, 2) each, mm."""
        x, y = self.size_mm
        ends = [((0, y), (0, 0)), ((0, 0), (x, 0)), ((x, y / 2), (x, y)), ((x, y), (x / 2, y))]
        return [np.array(side, dtype=np.float64) for side in ends]


@dataclass(frozen=True)
class View:
    """Position of the pattern in the picture.

    Attributes
    ----------
    matrix : (3, 3) float64
        From mm to pixels.
    mirrored : bool
        Whether it is seen from below, or the picture is flipped.
    um_per_px : float
        In the frame's middle.
    off_mm : float, mm
        Root mean square distance of the frame's ink from its straight sides.
    on_ink : float
        Share of the pattern that lies on ink.
    """

    matrix: FloatArray
    mirrored: bool
    um_per_px: float
    off_mm: float
    on_ink: float
