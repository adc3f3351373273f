"""Signed deviation of the scanned surface from the design.

Sign: **positive where the lumen (or the space outside) reaches beyond the design**: the lumen is
wider, the outer face worn; negative where gel stands in what should be free: the lumen is
narrower, the part too large. The sign is the same whether the model is the construct (gel) or the
lumens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.distance import ModelSurface

FloatArray = NDArray[np.float64]

TOLERANCES_UM = (25, 50, 100)


@dataclass(frozen=True)
class Deviation:
    """Summary of deviations, µm.

    Attributes
    ----------
    rms_um, mean_um, median_um, sd_um : float
        Of the signed deviation.
    p95_um : float
        95th percentile of its size.
    within : dict
        Share of the surface within 25, 50 and 100 µm.
    """

    rms_um: float
    mean_um: float
    median_um: float
    sd_um: float
    p95_um: float
    within: dict[int, float]


def deviations(surface: ModelSurface, points: FloatArray, model_is_lumen: bool) -> FloatArray:
    """Signed deviation of (n, 3) points in the part's frame, (n,), mm; exact."""
    distance = surface.query(points).distance
    return distance if model_is_lumen else -distance


def summarise(deviation_mm: FloatArray) -> Deviation:
    """Summary of deviations given in mm, at least one."""
    um = 1e3 * deviation_mm
    size = np.abs(um)
    return Deviation(
        rms_um=float(np.sqrt(np.mean(um**2))),
        mean_um=float(um.mean()),
        median_um=float(np.median(um)),
        sd_um=float(um.std()),
        p95_um=float(np.percentile(size, 95)),
        within={limit: float((size <= limit).mean()) for limit in TOLERANCES_UM},
    )
