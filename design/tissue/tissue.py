"""Data class of a tissue: closed surface, signed distance grid, perfusion demand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from design.tissue.demand import UNIFORM, Demand
from design.tissue.grid import SignedDistanceGrid

_FLAT = 1e-12
"""Sine of a corner below which its face has no area: the direction of its normal is rounding."""


@dataclass(frozen=True)
class Tissue:
    """A closed shape with its signed distance, and where in it perfusion is asked for.

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
        Where perfusion is asked for, relative to the greatest; uniform by default.
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
        area have no say.
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
        flat = sine <= _FLAT * np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
        weight = np.where(flat, 0.0, angle / np.where(flat, 1.0, sine))
        normal = (across * weight[:, None]).sum(axis=0)
        unit: NDArray[np.float64] = normal / np.linalg.norm(normal)
        return unit
