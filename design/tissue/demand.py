"""Demand models (uniform, by depth, image or function): relative perfusion wanted at points.

Growth that accepts a point with the probability `Demand.weight` places terminals by demand,
exactly; all terminals carry the same flow, so the tissue's total perfusion is as before and a
place's share of it is weight / mean_weight times the uniform one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.ndimage import map_coordinates

from design.errors import TissueError
from design.tissue.grid import SignedDistanceGrid
from kernels.arrays import FloatArray


class Demand(Protocol):
    """Demand relative to its greatest value.

    Attributes
    ----------
    mean_weight : float
        Mean of the weight over the tissue's volume, in (0, 1].
    """

    @property
    def mean_weight(self) -> float:
        """See the class."""
        ...

    def weight(self, points: FloatArray) -> FloatArray:
        """Weight (n,) in [0, 1] at ``points`` (n, 3), mm."""
        ...


@dataclass(frozen=True)
class UniformDemand:
    """Uniform perfusion demand."""

    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """Ones, (n,)."""
        return np.ones(len(points))


UNIFORM = UniformDemand()


@dataclass(frozen=True)
class DepthDemand:
    """A table against the depth below the surface, linear between its places and flat beyond.

    Attributes
    ----------
    grid : SignedDistanceGrid
        Of the tissue; its surface includes that of cavities and keep-out zones.
    depth_mm, level : (k,) float64
        Table, its greatest level 1.
    """

    grid: SignedDistanceGrid
    depth_mm: FloatArray
    level: FloatArray
    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`."""
        depth = -self.grid.distance(points)
        weight: FloatArray = np.interp(depth, self.depth_mm, self.level)
        return weight


@dataclass(frozen=True)
class ImageDemand:
    """A volume image, linear between the centres of voxels.

    Attributes
    ----------
    values : (a, b, c) float64
        At most 1.
    to_index : (4, 4) float64
        From mm to voxel indices.
    """

    values: FloatArray
    to_index: FloatArray
    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`; the nearest voxel's beyond the image."""
        index = np.asarray(points) @ self.to_index[:3, :3].T + self.to_index[:3, 3]
        sampled = map_coordinates(self.values, index.T, order=1, mode="nearest")
        return np.clip(np.asarray(sampled, dtype=np.float64), 0.0, 1.0)


@dataclass(frozen=True)
class FunctionDemand:
    """A function of points (n, 3), mm, that gives (n,) values.

    Attributes
    ----------
    greatest : float
        No value may be above it.
    """

    function: Callable[[FloatArray], FloatArray]
    greatest: float
    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`.

        Raises
        ------
        TissueError
            When a value is negative, NaN, or above ``greatest``: rejection wouldn't be exact.
        """
        values = checked_values(self.function, points)
        if values.max(initial=0.0) > self.greatest * (1 + 1e-12):
            raise TissueError(
                f"demand is {values.max():.6g}, above the greatest value {self.greatest:.6g} that "
                "was found or given; pass greatest= as high as the function goes"
            )
        return np.asarray(np.minimum(values / self.greatest, 1.0))


def checked_values(function: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """A demand function's values (n,) at ``points`` (n, 3), mm.

    Raises
    ------
    TissueError
        When they are of another shape, or as `check_values`.
    """
    values = np.asarray(function(points), dtype=np.float64)
    if values.shape != (len(points),):
        raise TissueError(
            f"demand function gave shape {values.shape} for {len(points)} points; give one value "
            "for each"
        )
    check_values(values, "demand function")
    return values


def check_values(values: FloatArray, what: str) -> None:
    """Refuse values that are negative, NaN or infinite; ``what`` names them in the message."""
    if not np.isfinite(values).all() or values.min(initial=0.0) < 0:
        raise TissueError(f"{what} has values that are negative, NaN or infinite; give 0 or more")
