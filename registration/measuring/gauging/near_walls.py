"""Assign scanned surface points to the vessel cross-section on whose wall they lie, if any."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kernels.arrays import FloatArray

LEAST_MM = 0.1
"""A wall is looked for within half a radius of the design's, and at least this."""
CLASS = 1.25
"""Radii of stations within which the nearest axis is that of the nearest wall."""


def near_walls(
    centre: FloatArray, radius: FloatArray, points: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the station whose lumen each point is deepest in, and whether the point is its wall.

    Where lumens meet, the design's wall is that of the lumen which reaches farther: beside a thin
    vessel's mouth in a wide one the wall is the wide one's, though the thin one's axis is nearer.

    Parameters
    ----------
    centre, radius : (s, 3), (s,) float64, mm
        Stations on vessels' axes.
    points : (n, 3) float64, mm

    Returns
    -------
    which : (n,) int64
        Some station where none is so near that the point could be a wall.
    wall : (n,) bool
    """
    reach = np.maximum(0.5 * radius, LEAST_MM)
    # Most of a part's surface is far from any vessel: nobody asks how far.
    farthest = float((radius + reach).max()) * (1 + 1e-9)
    away, which = cKDTree(centre).query(points, workers=1, distance_upper_bound=farthest)
    close = np.flatnonzero(np.isfinite(away))
    which = np.where(np.isfinite(away), which, 0).astype(np.int64)
    outside = away - radius[which]
    for stations in _classes(radius):
        bound = float((radius + reach)[stations].max()) * (1 + 1e-9)
        tree = cKDTree(centre[stations])
        far, nearest = tree.query(points[close], workers=1, distance_upper_bound=bound)
        chosen = stations[np.minimum(nearest, len(stations) - 1)]
        deeper = far - radius[chosen] < outside[close]
        outside[close[deeper]] = (far - radius[chosen])[deeper]
        which[close[deeper]] = chosen[deeper]
    return which, np.abs(outside) < reach[which]


def _classes(radius: FloatArray) -> list[NDArray[np.int64]]:
    """Stations of about one radius together; none where all are alike."""
    step = np.floor(np.log(radius / radius.min()) / np.log(CLASS)).astype(np.int64)
    classes = [np.flatnonzero(step == one) for one in np.unique(step)]
    return classes if len(classes) > 1 else []
