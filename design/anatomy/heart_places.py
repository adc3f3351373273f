"""Find a heart's base direction, right side, grooves and epicardium from surface samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.cavities import Cavities, find_cavities
from design.anatomy.heart_base import FEWEST, find_base
from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from kernels.arrays import FloatArray

_BASAL = 0.5
"""Cosine of the outward normal to the base's direction beyond which a place is the base, not the
epicardium."""

_SECTORS = 36

_AGREE = 0.7
"""Cosine of two directions of the right side, up to which they contradict each other."""
_UNEVEN = 0.1
"""Standard deviation of the wall's thickness over its mean, from which on it tells a side."""

_BY_SHAPE = (
    "the right ventricle was told by its cavity's shape, a crescent about the left one's, as the "
    "wall isn't thinner on that side; where it isn't the right one, give right_direction: "
    "[x, y, z], from the left ventricle to the right one"
)
_UNTOLD = (
    "the left ventricle can't be told from the right one, neither by the wall's thickness nor by "
    "the cavities' shapes, so that the right side may be the left one; give right_direction: "
    "[x, y, z], from the left ventricle to the right one"
)


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
    doubts : tuple of str
        Notes on directions that are guessed, with the remedy.
    """

    middle: FloatArray
    base: FloatArray
    right: FloatArray
    anterior: FloatArray
    grooves: tuple[float, float]
    epicardium: NDArray[np.int64]
    doubts: tuple[str, ...] = ()

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

    For base and right side see `find_base` and `_right_side`. The grooves are where the wall's
    thickness changes, a third of a turn from the right side at most, or 60 degrees where nothing
    tells.

    Raises
    ------
    TissueError
        Where base and right side are one direction, or the base can't be told.
    """
    outer = samples.outer
    hollow = bool((~outer).mean() >= FEWEST)
    middle = (samples.points[~outer] if hollow else samples.points).mean(axis=0)
    up, doubt = (_unit(base), ()) if base is not None else find_base(samples, middle)
    normal = -samples.inward
    epicardium = np.flatnonzero(outer & (normal @ up < _BASAL))
    wall = _wall(samples, epicardium)
    points = samples.points[epicardium] - middle
    thin, cavities = _thin_side(points, up, wall), find_cavities(samples)
    if right is None:
        right, doubts = _right_side(samples, up, thin, cavities)
        right = _widest_across(points, up) if right is None else right
        doubt = (*doubt, *doubts) if hollow else doubt
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
    if cavities is not None and not (thin is not None and thin @ side > _AGREE):
        wall = _is_left(samples, places, cavities)
    return replace(places, grooves=_grooves(angle, wall), doubts=doubt)


def _thin_side(points: FloatArray, up: FloatArray, wall: FloatArray) -> FloatArray | None:
    """Unit vector (3,) across ``up`` to where the wall is thinner; None where it is even."""
    across = points - np.outer(points @ up, up)
    thin = (across * (wall.mean() - wall)[:, None]).sum(axis=0)
    return _unit(thin) if wall.std() > _UNEVEN * wall.mean() else None


def _is_left(samples: SurfaceSamples, places: HeartPlaces, cavities: Cavities) -> FloatArray:
    """1 for each epicardial place that is nearer to the left cavity than to the right one."""
    points = samples.points[places.epicardium]
    one, two = samples.points[cavities.one], samples.points[cavities.two]
    if (two.mean(axis=0) - one.mean(axis=0)) @ places.right < 0.0:
        one, two = two, one
    nearer = cKDTree(one).query(points)[0] < cKDTree(two).query(points)[0]
    return np.asarray(nearer, dtype=np.float64)


def _right_side(
    samples: SurfaceSamples,
    up: FloatArray,
    thin: FloatArray | None,
    cavities: Cavities | None,
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Direction (3,) of the right ventricle, if any tells, and notes on what makes it doubtful.

    Where the wall is thinner; from the left cavity to the right one where that is another side, or
    the wall is as thick everywhere.
    """
    if cavities is None:
        return thin, () if thin is not None else (_UNTOLD,)
    apart = samples.points[cavities.two].mean(axis=0) - samples.points[cavities.one].mean(axis=0)
    apart = _unit(apart - (apart @ up) * up)
    along = 0.0 if thin is None else float(thin @ apart)
    if abs(along) > _AGREE and (along > 0.0 or not cavities.told):
        return thin, ()
    if cavities.told:
        return apart, (_BY_SHAPE,)
    reach = [(samples.points[each] @ up).min() for each in (cavities.one, cavities.two)]
    return apart if reach[0] <= reach[1] else -apart, (_UNTOLD,)


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
