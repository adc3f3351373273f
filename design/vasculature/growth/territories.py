"""Obstacles to a growing tree (vessels of other trees), and its own territory in the tissue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.growth.kernels.cost import SEGMENT
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Surroundings:
    """Vessels that a growing tree keeps clear of, and its territory.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Axes of the others' vessels.
    radius : (n,) float64, mm
    owns : function of (k, 3) float64 to (k,) bool, optional
        Which points lie in the territory; all by default.
    share : float
        Of the tissue's volume, and so of its flow, that the territory has.
    """

    start: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    end: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    radius: FloatArray = field(default_factory=lambda: np.empty(0))
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None = None
    share: float = 1.0

    @property
    def count(self) -> int:
        """Vessels of others."""
        return len(self.radius)

    def records(self) -> NDArray[np.void]:
        """The vessels as records of a growing tree that feed nothing and take no branch."""
        records = np.zeros(self.count, SEGMENT)
        for axis, names in enumerate((("px", "dx"), ("py", "dy"), ("pz", "dz"))):
            records[names[0]], records[names[1]] = self.start[:, axis], self.end[:, axis]
        records["radius"], records["full"], records["allowed"] = self.radius, 1, np.inf
        for name in ("parent", "left", "right"):
            records[name] = -1
        return records


class TerritorySettings(NamedTuple):
    """How a tissue is divided."""

    points: int = 20_000
    seed: int = 7
    """Points by which volumes are measured: a share of a half is known to 0.4 %."""
    max_iterations: int = 400
    tolerance: float = 2e-3
    """Of a share of the volume."""


TERRITORY = TerritorySettings()


@dataclass(frozen=True)
class Territories:
    """A power diagram: a point belongs to the root whose squared distance less weight is least.

    Attributes
    ----------
    centre : (k, 3) float64, mm
    weight : (k,) float64, mm²
    share : (k,) float64
        Of the tissue's volume in each, measured on points of its own.
    """

    centre: FloatArray
    weight: FloatArray
    share: FloatArray

    def owner(self, points: FloatArray) -> NDArray[np.int64]:
        """Territory of each of ``points`` (n, 3)."""
        return _owner(points, self.centre, self.weight)

    def owns(self, root: int) -> Callable[[FloatArray], NDArray[np.bool_]]:
        """Function that tells which points lie in a root's territory."""
        return partial(_in_territory, self, root)


def part_tissue(tissue: Tissue, centre: FloatArray, wanted: FloatArray) -> Territories:
    """Find weights that give each root its wanted share of the volume.

    The volumes are the gradient of a concave function of the weights (Aurenhammer, Hoffmann &
    Aronov 1998, doi 10.1007/PL00009187), so plain ascent with a step that shrinks when volumes
    overshoot gets there. Distances are straight: a territory may reach across a gap in the tissue.

    Parameters
    ----------
    centre : (k, 3) float64, mm
        Ends of the roots' stems.
    wanted : (k,) float64
        Shares; their sum is 1.

    Raises
    ------
    GrowthError
        When two roots are at the same place.
    """
    points = _points_inside(tissue)
    weight = np.zeros(len(centre))
    distance = np.linalg.norm(centre[:, None] - centre[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    if not (distance > 0).all():
        raise GrowthError("two roots of one kind have their stems' ends at one place; part them")
    step = float(np.ptp(tissue.bounds, axis=0).max()) ** 2
    before = np.zeros(len(centre))
    for _ in range(TERRITORY.max_iterations):
        share = np.bincount(_owner(points, centre, weight), minlength=len(centre)) / len(points)
        short = wanted - share
        if np.abs(short).max() < TERRITORY.tolerance:
            break
        if (short * before).sum() < 0:
            step *= 0.5
        weight = weight + step * short
        before = short
    return Territories(centre, weight, share)


def _points_inside(tissue: Tissue) -> FloatArray:
    low, high = tissue.bounds
    random = np.random.default_rng(TERRITORY.seed)
    points = np.empty((0, 3))
    while len(points) < TERRITORY.points:
        tried = random.uniform(low, high, (TERRITORY.points, 3))
        points = np.concatenate([points, tried[tissue.contains(tried)]])
    return points[: TERRITORY.points]


def _owner(points: FloatArray, centre: FloatArray, weight: FloatArray) -> NDArray[np.int64]:
    away = ((points[:, None] - centre[None]) ** 2).sum(axis=2)
    return np.argmin(away - weight, axis=1)


def _in_territory(parts: Territories, root: int, points: FloatArray) -> NDArray[np.bool_]:
    return parts.owner(points) == root
