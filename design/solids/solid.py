"""Solid: a closed triangle surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError


@dataclass(frozen=True)
class Solid:
    """A manifold, outward-oriented triangle mesh.

    Watertight in float32, as it is after writing and reading back.

    Attributes
    ----------
    vertices : (n, 3) float64, mm
        Every coordinate is representable in float32.
    faces : (m, 3) int32
        Counter-clockwise seen from outside.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]

    def __post_init__(self) -> None:
        if len(self.faces) == 0:
            raise SolidError("solid has no faces; the shape is empty")

    @property
    def volume_mm3(self) -> float:
        """Enclosed volume by the divergence theorem, mm³."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner, (2, 3), mm."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def moved(self, offset_mm: NDArray[np.float64]) -> Solid:
        """The same solid translated by ``offset_mm`` (3,)."""
        return Solid(self.vertices + offset_mm, self.faces)
