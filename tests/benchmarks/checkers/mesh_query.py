"""Brute-force distance and winding number of points: every triangle for every point.

NumPy alone, no tree, no compiler: slow, and with nothing to get wrong in a search. It vouches for
the checkers' own tree, which in turn checks the product at many more points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def brute_distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Distance of each point (n, 3) from the nearest of triangles (f, 3, 3), (n,)."""
    return np.array([_distances(p, triangles).min() for p in points])


def brute_windings(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Winding number of each point (n,): solid angles over 4π (van Oosterom & Strackee 1983)."""
    found = np.empty(len(points))
    for n, point in enumerate(points):
        a, b, c = (triangles[:, k] - point for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        found[n] = np.arctan2(above, below).sum() / (2 * np.pi)
    return found


def _distances(point: FloatArray, triangles: FloatArray) -> FloatArray:
    """To the foot of the perpendicular where it is within the triangle, else to the edges."""
    corner = [triangles[:, k] for k in range(3)]
    best = np.full(len(triangles), np.inf)
    for k in range(3):
        a, b = corner[k], corner[(k + 1) % 3]
        along, to = b - a, point - a
        square = (along * along).sum(1)
        t = np.clip(np.divide((to * along).sum(1), square, where=square > 0, out=0 * square), 0, 1)
        best = np.minimum(best, np.linalg.norm(to - t[:, None] * along, axis=1))
    normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    within = np.ones(len(triangles), dtype=bool)
    for k in range(3):
        side = np.cross(corner[(k + 1) % 3] - corner[k], point - corner[k])
        within &= (side * normal).sum(1) >= 0
    size = np.linalg.norm(normal, axis=1)
    within &= size > 0
    height = np.abs(((point - corner[0]) * normal).sum(1)[within]) / size[within]
    best[within] = np.minimum(best[within], height)
    return best
