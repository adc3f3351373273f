"""Find glints: voxels far brighter than gel, such as air, particles and specular walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray

FloatVolume = NDArray[np.float32]

GLINT = 15.0
"""Times the gel's mean. Of 3 million voxels of fully developed speckle, exponential, one lies above
it: ln(3e6) = 15."""
USUAL_PERCENT = 50.0
"""Of the A-scans' brightest voxels: what walls of this part send back where they face the light, as
its top does in nearly all A-scans. Air along a drained lumen fills many, but not half of them."""


@dataclass(frozen=True)
class Glints:
    """Glints of a scan.

    Attributes
    ----------
    place : (n, 3) float64, mm
        In the scan.
    share : (n,) float64
        Brightness, of the gel's mean.
    usual : float
        Brightness that half of the A-scans exceed somewhere.
    down : int
        1 where light runs towards larger z, else -1.
    """

    place: FloatArray
    share: FloatArray
    usual: float
    down: int


def find_glints(
    share: FloatVolume, voxel_mm: FloatArray, origin_mm: FloatArray, depth_down: bool
) -> Glints:
    """Return the glints of a signal in units of the gel's mean, (nz, ny, nx), uncapped."""
    index = np.argwhere(share > GLINT)
    brightest = share.max(axis=0)
    return Glints(
        origin_mm + index[:, ::-1] * voxel_mm,
        share[tuple(index.T)].astype(np.float64),
        float(np.percentile(brightest, USUAL_PERCENT)),
        1 if depth_down else -1,
    )


def no_glints() -> Glints:
    """Return the glints of a volume that no light went through."""
    return Glints(np.empty((0, 3)), np.empty(0), 0.0, 1)
