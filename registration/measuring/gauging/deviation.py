"""Signed deviation of the scanned surface from the design; lumens and outer faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.network import VesselNetwork
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


_REACH_MM = 0.2
"""A face belongs to a lumen when it lies within this, or a third of the radius, of its wall."""


def split_summary(
    vertices: FloatArray,
    network: VesselNetwork,
    rigid_um: FloatArray,
    scaled_um: FloatArray,
) -> dict[str, dict[str, object] | None]:
    """Summarise lumens and outer faces apart, as registration.json holds them.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
        Seen places of the scanned surface, part frame.
    network : VesselNetwork
    rigid_um, scaled_um : (n,) float64, µm
        Their deviations after both fits.

    Returns
    -------
    dict
        ``lumens`` and ``outer_faces``, each with ``points``, ``rigid``, ``scaled``, ``histogram``
        and ``within_curve``; one without points is None.
    """
    lumen = near_lumen(vertices, network)
    return {
        name: {
            "points": int(which.sum()),
            "rigid": deviation_numbers(summarise(1e-3 * rigid_um[which])),
            "scaled": deviation_numbers(summarise(1e-3 * scaled_um[which])),
            "histogram": {
                "edges_um": HISTOGRAM_EDGES_UM.tolist(),
                "counts": histogram(1e-3 * scaled_um[which]).tolist(),
                "counts_rigid": histogram(1e-3 * rigid_um[which]).tolist(),
            },
            "within_curve": {
                "tolerance_um": CURVE_UM.tolist(),
                "rigid": within_curve(1e-3 * rigid_um[which]).round(5).tolist(),
                "scaled": within_curve(1e-3 * scaled_um[which]).round(5).tolist(),
            },
        }
        if which.any()
        else None
        for name, which in (("lumens", lumen), ("outer_faces", ~lumen))
    }


def deviation_numbers(deviation: Deviation) -> dict[str, object]:
    """Return a deviation as registration.json holds it."""
    return {
        **asdict(deviation),
        "within": {f"{limit:g}": share for limit, share in deviation.within.items()},
    }


def near_lumen(points: FloatArray, network: VesselNetwork) -> NDArray[np.bool_]:
    """Whether each of ``points`` (n, 3) lies near the wall of a vessel of ``network``, or in it."""
    centre, radius = _samples(network)
    # A few neighbours: of a wide and a thin vessel side by side the nearest axis isn't the one.
    reach = radius + np.maximum(_REACH_MM, radius / 3)
    distance, index = KDTree(centre).query(
        points, k=min(4, len(centre)), distance_upper_bound=np.nextafter(reach.max(), np.inf)
    )
    # Of neighbours that are farther, the distance is infinite and the number none of these.
    near: NDArray[np.bool_] = distance <= np.append(reach, 0.0)[index]
    return np.asarray(near.reshape(len(points), near.size // max(len(points), 1)).any(axis=1))


def _samples(network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Points on the axes, closer than half a radius to one another, and their radii."""
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    counts = np.ceil(2 * length / np.minimum(r0, r1)).astype(np.int64) + 1
    piece = np.repeat(np.arange(len(start)), counts)
    first = np.cumsum(counts) - counts
    share = (np.arange(len(piece)) - first[piece]) / (counts[piece] - 1)
    centre = start[piece] + share[:, None] * (end - start)[piece]
    return centre, r0[piece] + share * (r1 - r0)[piece]
