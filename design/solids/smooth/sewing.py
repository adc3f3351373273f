"""Lumen surface under assembly: faces so far, rings that pieces share, faces of each tube."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from design.solids.smooth.layout import End
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int64]


@dataclass
class Sewing:
    """Closed surface under assembly.

    Attributes
    ----------
    vertices, faces : list of arrays
    count : int
        Vertices so far.
    rings : dict of (run, end) to (n,) int64
        Vertices of the open end of each plain tube.
    tubes : dict of run to slice
        Faces of each plain tube, among all.
    """

    vertices: list[FloatArray] = field(default_factory=list)
    faces: list[FaceArray] = field(default_factory=list)
    count: int = 0
    rings: dict[End, NDArray[np.int64]] = field(default_factory=dict)
    tubes: dict[int, slice] = field(default_factory=dict)

    def add(self, vertices: FloatArray, faces: FaceArray) -> int:
        """Add a piece whose vertices are all its own; returns the number of its first one."""
        first = self.count
        self.vertices.append(vertices)
        self.faces.append(faces + first)
        self.count += len(vertices)
        return first

    def sew(self, vertices: FloatArray, faces: FaceArray, known: NDArray[np.int64]) -> None:
        """Add a piece with vertices that are here already: ``known`` (n,), -1 for the others."""
        number = known.copy()
        fresh = number < 0
        number[fresh] = self.count + np.arange(int(fresh.sum()))
        self.vertices.append(vertices[fresh])
        self.faces.append(number[faces])
        self.count += int(fresh.sum())

    def place(self, ring: NDArray[np.int64]) -> FloatArray:
        """Positions of a ring of the tubes, which were added first and as one array."""
        return self.vertices[0][ring]

    def tube(self, run: int) -> FaceArray:
        """Faces (m, 3) of a run's plain tube."""
        return self.faces[0][self.tubes[run]]

    def surface(self) -> tuple[FloatArray, FaceArray]:
        """All vertices (n, 3), mm, and faces (m, 3) so far."""
        return np.concatenate(self.vertices), np.concatenate(self.faces)
