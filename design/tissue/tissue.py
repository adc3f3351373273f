"""Data class of a tissue: closed surface, signed distance grid, perfusion demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.grid import SignedDistanceGrid
from kernels.arrays import FloatArray


class Demand(Protocol):
    """Demand relative to its greatest value.

    Growth that accepts a point with the probability `Demand.weight` places terminals by demand,
    exactly; all terminals carry the same flow, so the tissue's total perfusion is as before and a
    place's share of it is weight / mean_weight times the uniform one.

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


MIN_SINE = 1e-12
"""Of a face's corner; below it the face has no area, and its normal's direction is rounding."""


@dataclass(frozen=True)
class Tissue:
    """A closed shape with its signed distance, and the perfusion demand in it.

    Closed cavities, thin walls and shells within shells follow the winding number of the
    surface: a cavity's surface looks into the cavity, which is outside.

    Attributes
    ----------
    grid : SignedDistanceGrid
        Negative inside.
    surface : Surface
        Closed; seen from outside the tissue.
    volume_mm3 : float
        Of the tissue, cavities excluded.
    thinnest_wall_mm : float
        First percentile of the wall's thickness over its surface; inf where no two faces are
        opposite.
    notes : tuple of str
        What was done to the surface on its way here that the user should know: repairs, zones
        that miss, choices made.
    demand : Demand
        Relative to its greatest value; uniform by default.
    """

    grid: SignedDistanceGrid
    surface: Surface
    volume_mm3: float
    thinnest_wall_mm: float
    notes: tuple[str, ...] = ()
    demand: Demand = UNIFORM

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner, (2, 3), mm; kept, as growth asks for each lot of points."""
        return self.surface.bounds

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each of ``points`` (n, 3) lies inside."""
        inside: NDArray[np.bool_] = self.grid.distance(points) < 0
        return inside

    def top_vertex(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The vertex of largest z and its inward unit normal, (3,) each.

        Of several at the same height, the one nearest the middle of the bounds. The normal is
        the mean of the adjoining faces' weighted by their angle at the vertex; faces without
        area don't count.
        """
        height = self.surface.vertices[:, 2]
        top = np.flatnonzero(height >= height.max() - 1e-9 * np.ptp(height))
        away = np.linalg.norm(self.surface.vertices[top] - self.bounds.mean(axis=0), axis=1)
        vertex = int(top[np.argmin(away)])
        return self.surface.vertices[vertex], -self._vertex_normal(vertex)

    def _vertex_normal(self, vertex: int) -> NDArray[np.float64]:
        face, corner = np.nonzero(self.surface.faces == vertex)
        here = self.surface.vertices[vertex]
        one = self.surface.vertices[self.surface.faces[face, (corner + 1) % 3]] - here
        two = self.surface.vertices[self.surface.faces[face, (corner + 2) % 3]] - here
        across = np.cross(one, two)
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, np.einsum("ij,ij->i", one, two))
        flat = sine <= MIN_SINE * np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
        weight = np.where(flat, 0.0, angle / np.where(flat, 1.0, sine))
        normal = (across * weight[:, None]).sum(axis=0)
        unit: NDArray[np.float64] = normal / np.linalg.norm(normal)
        return unit
