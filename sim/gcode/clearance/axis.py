"""Find the arc length on a vessel's centreline nearest to given points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from kernels.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


_SPACING_MM: Final = 0.05
"""Of the places among which the nearest is looked for, before it is made exact."""


@dataclass(frozen=True)
class Axis:
    """Short stretches of an axis.

    Attributes
    ----------
    spots : (k, 3) float64, mm
    arc : (k,) float64, mm
        Of each along the axis.
    tree : cKDTree
        Of the spots.
    """

    spots: FloatArray
    arc: FloatArray
    tree: cKDTree

    @staticmethod
    def of(points: FloatArray, arc: FloatArray) -> Axis:
        """Of a polyline (p, 3) with arcs (p,), mm."""
        from scipy.spatial import cKDTree  # loads for 0.3 s; few jobs come here

        count = np.maximum(np.ceil(np.diff(arc) / _SPACING_MM), 1).astype(np.int64)
        at = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count)) / count[at]
        dense = np.append(arc[at] + share * np.diff(arc)[at], arc[-1])
        spots = np.append(points[at] + share[:, None] * np.diff(points, axis=0)[at], points[-1:], 0)
        return Axis(spots, dense, cKDTree(spots))

    def nearest(self, place: FloatArray) -> FloatArray:
        """Arc of what is nearest to each of (n, 3) places, (n,), mm."""
        spots, arc, nearest = self.spots, self.arc, self.tree.query(place)[1]
        best, best_arc = np.full(len(place), np.inf), arc[nearest]
        for side in (-1, 0):
            a = np.clip(nearest + side, 0, len(spots) - 2)
            step = spots[a + 1] - spots[a]
            square = np.maximum((step**2).sum(axis=1), 1e-300)
            t = np.clip(((place - spots[a]) * step).sum(axis=1) / square, 0.0, 1.0)
            gap = np.linalg.norm(spots[a] + t[:, None] * step - place, axis=1)
            best_arc = np.where(gap < best, arc[a] + t * (arc[a + 1] - arc[a]), best_arc)
            best = np.minimum(best, gap)
        return best_arc
