"""Summarise the scanned surface's deviation separately for lumens and outer faces."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.measuring.gauging.deviation import (
    CURVE_UM,
    HISTOGRAM_EDGES_UM,
    histogram,
    summarise,
    within_curve,
)

_REACH_MM = 0.2
"""A face belongs to a lumen when it lies within this, or a third of the radius, of its wall."""


def split_summary(
    vertices: FloatArray,
    network: VesselNetwork,
    rigid_um: FloatArray,
    scaled_um: FloatArray,
) -> dict[str, Any]:
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
            "rigid": _plain(rigid_um[which]),
            "scaled": _plain(scaled_um[which]),
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


def _plain(deviation_um: FloatArray) -> dict[str, Any]:
    summary = asdict(summarise(1e-3 * deviation_um))
    summary["within"] = {f"{limit:g}": share for limit, share in summary["within"].items()}
    return summary


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
