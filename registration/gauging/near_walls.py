"""Points of a scanned surface that are a vessel's wall, and the vessel of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]

LEAST_MM = 0.1
"""A wall is looked for within half a radius of the design's, and at least this."""


def near_walls(
    centre: FloatArray, radius: FloatArray, points: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the nearest station of each point, and whether the point is its wall.

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
    which = np.minimum(which, len(centre) - 1).astype(np.int64)
    return which, np.abs(away - radius[which]) < reach[which]
