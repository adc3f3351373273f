"""Data classes of a triangle surface and of what a mesh file holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Surface:
    """A triangle surface, counter-clockwise seen from outside; it promises no more.

    A closed one that can be printed is a `design.solids.Solid`, one whose faces belong to patches
    a `design.solids.repair.remesh.LabelledSurface`.

    Attributes
    ----------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int32, or int64 where kernels want it
    """

    vertices: FloatArray
    faces: NDArray[Any]

    @property
    def volume_mm3(self) -> float:
        """Enclosed volume by the divergence theorem, mm³."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner, (2, 3), mm."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])


@dataclass(frozen=True)
class MeshFile:
    """Triangles of a mesh file; of a 3MF, those that are printed.

    Attributes
    ----------
    vertices : (n, 3) float64, in `unit`
    faces : (m, 3) int64
    unit : str
        As the file spells it; empty where it has none.
    notes : tuple of str
        What was left out or cut out.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str = ""
    notes: tuple[str, ...] = ()


START_BYTES: Final = 84
"""Header, and how many triangles follow."""
TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
