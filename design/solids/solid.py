"""Data class of a solid: a closed, outward-oriented triangle surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.surface import Surface


@dataclass(frozen=True)
class Solid(Surface):
    """A manifold, outward-oriented triangle mesh.

    Watertight in float32, as it is after writing and reading back.

    Attributes
    ----------
    vertices : (n, 3) float64, mm
        Every coordinate is representable in float32.
    faces : (m, 3) int32
        Counter-clockwise seen from outside.
    uncrossed : bool
        Every two faces have been tried, and none cross. False where that isn't known.
    notes : tuple of str
        What of its file was left out or cut out.
    """

    faces: NDArray[np.int32]
    uncrossed: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.faces) == 0:
            raise SolidError("solid has no faces; the shape is empty")

    def moved(self, offset_mm: NDArray[np.float64]) -> Solid:
        """The same solid translated by ``offset_mm`` (3,)."""
        return Solid(self.vertices + offset_mm, self.faces)
