"""Cut vessels into pieces that can be written in one upward pass."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from design.network import VesselNetwork
from design.toolpath.toolpath import FloatArray

#: A move's radius differs from its neighbour's by at most this part along a taper.
TAPER_STEP = 0.05


@dataclass(frozen=True)
class Piece:
    """A stretch of one vessel whose height has no turning point.

    Attributes
    ----------
    points : (k, 3) float64, mm
        From its lower end to its upper one.
    radius : (k,) float64, mm
    vessel : int
    ends : (int, int)
        Nodes at its two ends; a turning point inside a vessel has a number of its own, above
        the network's.
    reversible : bool
        Whether it is so level that it may be written either way.
    """

    points: FloatArray
    radius: FloatArray
    vessel: int
    ends: tuple[int, int]
    reversible: bool

    def reversed(self) -> Piece:
        """Return the same piece from its other end."""
        return replace(
            self, points=self.points[::-1], radius=self.radius[::-1], ends=self.ends[::-1]
        )

    def extended(self, overlap_radii: float) -> Piece:
        """Return the same piece, gone on straight past its last point by so many radii."""
        reach = overlap_radii * self.radius[-1]
        if reach == 0:
            return self
        way = self.points[-1] - self.points[-2]
        beyond = self.points[-1] + reach * way / np.linalg.norm(way)
        return replace(
            self,
            points=np.vstack([self.points, beyond]),
            radius=np.append(self.radius, self.radius[-1]),
        )


def cut(network: VesselNetwork) -> list[Piece]:
    """Cut each vessel at its turning points in height.

    Going down steeply, the shaft would pass through what was written just before; a stretch
    without turning points is written from its lower end. Turns lower than the vessel's mean
    radius don't count.
    """
    pieces: list[Piece] = []
    node = len(network.nodes)
    for vessel, (points, radius) in enumerate(network.polylines()):
        points, radius = _refine(*_without_repeats(points, radius))
        tolerance = float(radius.mean())
        turns = turning_points(points[:, 2], tolerance)
        first = int(network.vessel_nodes[vessel, 0])
        for low, high in pairwise(turns):
            last = int(network.vessel_nodes[vessel, 1]) if high == turns[-1] else node
            node += last == node
            part = slice(low, high + 1)
            rise = points[high, 2] - points[low, 2]
            level = bool(np.ptp(points[part, 2]) <= tolerance)
            piece = Piece(points[part], radius[part], vessel, (first, last), level)
            pieces.append(piece if rise >= 0 else piece.reversed())
            first = last
    return pieces


def turning_points(height: FloatArray, tolerance: float) -> list[int]:
    """Indices of the ends and of every top and bottom that stands out by ``tolerance``."""
    turns, low, high, way = [0], 0, 0, 0
    for index in range(1, len(height)):
        if height[index] > height[high]:
            high = index
        if height[index] < height[low]:
            low = index
        if way != -1 and height[high] - height[index] > tolerance:
            turns.append(high)
            way, low = -1, index
        elif way != 1 and height[index] - height[low] > tolerance:
            turns.append(low)
            way, high = 1, index
    turns.append(len(height) - 1)
    return sorted(set(turns))


def _without_repeats(points: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9
    keep = np.concatenate([[True], moves])
    return points[keep], radius[keep]


def _refine(points: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Insert points where the radius changes much along one straight stretch."""
    count = np.ceil(np.abs(np.diff(np.log(radius))) / TAPER_STEP).astype(int).clip(min=1)
    if count.max(initial=1) == 1:
        return points, radius
    place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)])
    place = np.append(place, len(points) - 1)
    whole = np.arange(len(points))
    finer = np.column_stack([np.interp(place, whole, points[:, axis]) for axis in range(3)])
    return finer, np.interp(place, whole, radius)
