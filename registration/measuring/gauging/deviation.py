"""Signed deviation of the scanned surface from the design, and its summary statistics.

Sign: **positive where the lumen (or the space outside) reaches beyond the design**: the lumen is
wider, the outer face worn; negative where gel stands in what should be free: the lumen is
narrower, the part too large. The sign is the same whether the model is the construct (gel) or the
lumens, and in both directions of measuring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface

TOLERANCES_UM = (25.0, 50.0, 100.0)
HISTOGRAM_EDGES_UM = np.arange(-200.0, 201.0, 5.0)
CURVE_UM = np.concatenate([np.arange(0.0, 100.0, 2.0), np.arange(100.0, 301.0, 10.0)])
"""Tolerances for which the share within is told."""


@dataclass(frozen=True)
class Deviation:
    """Summary of deviations, µm.

    Attributes
    ----------
    rms_um, mean_um, median_um, sd_um : float
        Of the signed deviation.
    p95_um, max_um : float
        95th percentile and largest of its size.
    within : dict
        Share of the surface within each tolerance in µm.
    """

    rms_um: float
    mean_um: float
    median_um: float
    sd_um: float
    p95_um: float
    max_um: float
    within: dict[float, float]


def deviations(surface: ModelSurface, points: FloatArray, model_is_lumen: bool) -> FloatArray:
    """Signed deviation of (n, 3) points in the part's frame, (n,), mm; exact."""
    distance = surface.query(points).distance
    return distance if model_is_lumen else -distance


def summarise(
    deviation_mm: FloatArray, tolerances_um: Sequence[float] = TOLERANCES_UM
) -> Deviation:
    """Summary of deviations given in mm; NaN throughout when there are none."""
    um = 1e3 * deviation_mm if len(deviation_mm) else np.array([np.nan])
    size = np.abs(um)
    return Deviation(
        rms_um=float(np.sqrt(np.mean(um**2))),
        mean_um=float(um.mean()),
        median_um=float(np.median(um)),
        sd_um=float(um.std()),
        p95_um=float(np.percentile(size, 95)),
        max_um=float(size.max()),
        within={limit: share_within(deviation_mm, limit) for limit in tolerances_um},
    )


def share_within(deviation_mm: FloatArray, tolerance_um: float) -> float:
    """Share of deviations (mm) no larger than a tolerance in µm; NaN when there are none."""
    if len(deviation_mm) == 0:
        return float("nan")
    return float((1e3 * np.abs(deviation_mm) <= tolerance_um).mean())


def histogram(deviation_mm: FloatArray) -> NDArray[np.int64]:
    """Counts between `HISTOGRAM_EDGES_UM`; the outermost hold what lies beyond."""
    clipped = np.clip(1e3 * deviation_mm, HISTOGRAM_EDGES_UM[0], HISTOGRAM_EDGES_UM[-1])
    return np.histogram(clipped, HISTOGRAM_EDGES_UM)[0].astype(np.int64)


def within_curve(deviation_mm: FloatArray) -> FloatArray:
    """Share within each tolerance of `CURVE_UM`."""
    return np.array([share_within(deviation_mm, limit) for limit in CURVE_UM])


def hausdorff_p95_um(there_mm: FloatArray, back_mm: FloatArray) -> float:
    """95 % Hausdorff distance, µm: the larger of the two directions' 95th percentiles.

    After Huttenlocher et al. 1993 (doi 10.1109/34.232073), the quantile taken in each direction.
    """
    if len(there_mm) == 0 or len(back_mm) == 0:
        return float("nan")
    return 1e3 * max(float(np.percentile(np.abs(d), 95)) for d in (there_mm, back_mm))
