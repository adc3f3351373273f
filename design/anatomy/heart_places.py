"""Find a heart's base direction, right side, grooves and epicardium from surface samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from kernels.arrays import FloatArray

_BASAL = 0.5
"""Cosine of the outward normal to the base's direction beyond which a place is the base, not the
epicardium."""

_SECTORS = 36
FEWEST = 0.03
"""Share of the surface that isn't outer below which there are no cavities to go by."""

_RIM = 2.0
"""Way of a cavity's place from the outer surface within which it lies at the rim, over the way
between places."""
_FEWEST_RIM = 12
_FLAT = 0.2
"""Standard deviation of rims off a plane, over the lesser one in it, up to which they have one."""
_LIKELY = 0.5
"""Cosine between that plane's normal and the direction found without, below which it is no base."""


@dataclass(frozen=True)
class HeartPlaces:
    """Directions and places of a heart.

    Attributes
    ----------
    middle : (3,) float64, mm
        Of the ventricles' cavities.
    base : (3,) float64
        Unit vector from the apex to the base.
    right : (3,) float64
        Unit vector across it, towards the right ventricle.
    anterior : (3,) float64
        Unit vector across both.
    grooves : (float, float), rad
        Angles of the anterior and posterior interventricular grooves, from ``right`` towards
        ``anterior``: between 0 and π, and between -π and 0.
    epicardium : (k,) int64
        Numbers of the surface samples that are epicardium.
    """

    middle: FloatArray
    base: FloatArray
    right: FloatArray
    anterior: FloatArray
    grooves: tuple[float, float]
    epicardium: NDArray[np.int64]

    def height(self, points: FloatArray) -> FloatArray:
        """Along the base's direction from the middle, mm."""
        height: FloatArray = (points - self.middle) @ self.base
        return height

    def angle(self, points: FloatArray) -> FloatArray:
        """About the base's direction, from ``right`` towards ``anterior``, rad."""
        along = points - self.middle
        angle: FloatArray = np.arctan2(along @ self.anterior, along @ self.right)
        return angle


def find_heart_places(
    samples: SurfaceSamples,
    base: FloatArray | None = None,
    right: FloatArray | None = None,
) -> HeartPlaces:
    """Find base, right side and grooves; a direction that is given is taken.

    The base lies across the cavities' rims; else where they open, away from the apex. The right
    ventricle lies where the wall is thinner. The grooves are where the wall's thickness changes, a
    third of a turn from the right side at most, or 60 degrees where nothing tells.

    Raises
    ------
    TissueError
        Where base and right side are one direction.
    """
    outer = samples.outer
    cavity = samples.points[~outer] if (~outer).mean() >= FEWEST else samples.points
    middle = cavity.mean(axis=0)
    up = _unit(base) if base is not None else _base(samples, middle)
    normal = -samples.inward
    epicardium = np.flatnonzero(outer & (normal @ up < _BASAL))
    wall = _wall(samples, epicardium)
    points = samples.points[epicardium] - middle
    if right is None:
        across = points - np.outer(points @ up, up)
        thin = wall.mean() - wall
        right = (across * thin[:, None]).sum(axis=0) if wall.std() > 0.1 * wall.mean() else None
    if right is None:
        right = _widest_across(points, up)
    across = right - (right @ up) * up
    if np.linalg.norm(across) < 1e-3 * np.linalg.norm(right):
        raise TissueError(
            f"the heart's right side, {np.round(right, 3).tolist()}, lies in the direction of its "
            "base; give a right_direction across base_direction"
        )
    side = _unit(across)
    front = np.cross(up, side)
    places = HeartPlaces(middle, up, side, front, (np.pi / 3, -np.pi / 3), epicardium)
    angle = places.angle(samples.points[epicardium])
    return HeartPlaces(middle, up, side, front, _grooves(angle, wall), epicardium)


def _base(samples: SurfaceSamples, middle: FloatArray) -> FloatArray:
    """Direction of the base: across the cavities' rims where these lie in a plane.

    Else the mean of where cavities open, and of apex to middle. A right ventricle that is cut low
    opens sideways, which turned that mean by up to 45 degrees.
    """
    outer = samples.points[samples.outer]
    inner = ~samples.outer
    out = samples.way_out[inner].sum(axis=0) if inner.mean() >= FEWEST else np.zeros(3)
    if np.linalg.norm(out) < 1e-3 * max(1, inner.sum()):
        apex = outer[np.argmax(np.linalg.norm(outer - middle, axis=1))]
        return _unit(middle - apex)
    out = _unit(out)
    below = (outer - middle) @ out < 0
    apex = outer[below][np.argmax(np.linalg.norm(outer[below] - middle, axis=1))]
    mean = _unit(out + _unit(middle - apex))
    across = _across_rims(samples, middle, mean)
    along = float(across @ mean)
    return mean if abs(along) < _LIKELY else np.sign(along) * across


def _across_rims(samples: SurfaceSamples, middle: FloatArray, up: FloatArray) -> FloatArray:
    """Unit normal of the plane in which the cavities' rims lie, 0 where they don't lie in one.

    Clefts below the middle, as between two apices, are no rims of theirs.
    """
    none = np.zeros(3)
    inner = samples.points[~samples.outer]
    spacing = np.median(cKDTree(samples.points).query(samples.points, 2)[0][:, 1])
    away = cKDTree(samples.points[samples.outer]).query(inner)[0]
    rim = inner[(away < _RIM * spacing) & ((inner - middle) @ up > 0.0)]
    if len(rim) < _FEWEST_RIM:
        return none
    off = rim - rim.mean(axis=0)
    spread, axes = np.linalg.eigh(off.T @ off)
    return axes[:, 0] if spread[0] < _FLAT**2 * spread[1] else none


def _wall(samples: SurfaceSamples, epicardium: NDArray[np.int64]) -> FloatArray:
    """Thickness of the wall below each epicardial sample, mm; even over its surroundings."""
    inner = samples.points[~samples.outer]
    points = samples.points[epicardium]
    if len(inner) < FEWEST * len(samples.points):
        return np.ones(len(points))
    thick = cKDTree(inner).query(points)[0]
    near = cKDTree(points).query(points, min(40, len(points)))[1]
    even: FloatArray = thick[near].mean(axis=1)
    return even


def _grooves(angle: FloatArray, wall: FloatArray) -> tuple[float, float]:
    """Angles on either side of 0 at which the wall becomes thick."""
    sector = np.floor((angle + np.pi) / (2 * np.pi) * _SECTORS).astype(np.int64) % _SECTORS
    count = np.bincount(sector, minlength=_SECTORS)
    mean = np.bincount(sector, wall, minlength=_SECTORS) / np.maximum(count, 1)
    mean[count == 0] = wall.mean()
    middle = 0.5 * (np.percentile(mean, 10) + np.percentile(mean, 90))
    angles = []
    for side in (1, -1):
        steps = [(_SECTORS // 2 + side * n - (side < 0)) % _SECTORS for n in range(_SECTORS // 3)]
        thick = [n for n in range(2, len(steps)) if mean[steps[n]] > middle]
        clear = np.ptp(mean) > 0.25 * wall.mean()
        widest = thick[0] if thick else len(steps)
        angles.append(side * (2 * np.pi / _SECTORS * widest if clear else np.pi / 3))
    return angles[0], angles[1]


def _widest_across(points: FloatArray, axis: FloatArray) -> FloatArray:
    """The direction across an axis in which points reach furthest."""
    across = points - np.outer(points @ axis, axis)
    _, vectors = np.linalg.eigh(across.T @ across)
    widest = vectors[:, -1]
    # The sign by the largest component, so that the same shape gives the same direction.
    return np.asarray(widest * np.sign(widest[np.argmax(np.abs(widest))]), dtype=np.float64)


def _unit(vector: FloatArray) -> FloatArray:
    unit: FloatArray = np.asarray(vector, dtype=np.float64) / np.linalg.norm(vector)
    return unit
