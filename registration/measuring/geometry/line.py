"""Designed axis of one vessel: polyline, straightness, ends, nearest points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray

_STRAIGHT_MM = 0.002
"""A design that leaves a straight line, or one radius, by less has none but rounding."""


@dataclass(frozen=True)
class Line:
    """A designed axis.

    Attributes
    ----------
    points : (k, 3) float64, mm
        Polyline, its ends carried on by a millimetre.
    radius : (k,) float64, mm
    length : float, mm
        Without what was carried on.
    straight, even : bool
        Straight from end to end; of one radius.
    """

    points: FloatArray
    radius: FloatArray
    length: float
    straight: bool
    even: bool

    @staticmethod
    def of(network: VesselNetwork, vessel: int) -> Line:
        """Return a vessel's designed axis."""
        points, radius = network.polyline(vessel)
        chord = unit(points[-1] - points[0])
        off = points - points[0] - ((points - points[0]) @ chord)[:, None] * chord
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        before = points[0] - unit(points[1] - points[0])
        after = points[-1] - unit(points[-2] - points[-1])
        return Line(
            np.vstack([before, points, after]),
            np.concatenate([radius[:1], radius, radius[-1:]]),
            length,
            bool(np.linalg.norm(off, axis=1).max() < _STRAIGHT_MM),
            bool(np.ptp(radius) < _STRAIGHT_MM),
        )

    def end(self, last: bool) -> tuple[FloatArray, FloatArray, float]:
        """First or last node, the unit way there along the axis, and the radius."""
        if last:
            way = self.points[-1] - self.points[-2]
            return self.points[-2], unit(way), float(self.radius[-1])
        return self.points[1], unit(self.points[0] - self.points[1]), float(self.radius[0])

    def nearest(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (n, 3) of the axis to places (n, 3), and the radii there (n,), mm."""
        best = np.full(len(places), np.inf)
        foot, radius = np.empty_like(places), np.empty(len(places))
        for a, b, ra, rb in zip(
            self.points, self.points[1:], self.radius, self.radius[1:], strict=False
        ):
            way = b - a
            t = np.clip((places - a) @ way / max(way @ way, 1e-18), 0.0, 1.0)
            here = a + t[:, None] * way
            away = ((places - here) ** 2).sum(axis=1)
            nearer = away < best
            best = np.where(nearer, away, best)
            foot[nearer], radius[nearer] = here[nearer], (ra + t * (rb - ra))[nearer]
        return foot, radius


def unit(vector: FloatArray) -> FloatArray:
    """Return a vector's direction."""
    return np.asarray(vector / np.linalg.norm(vector))
