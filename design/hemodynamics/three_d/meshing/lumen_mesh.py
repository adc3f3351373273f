"""Data class of a lumen mesh: quadratic tetrahedra, wall and ports, for all 3D solvers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray, IntArray

WALL = 0
"""Label of the wall's faces; port k has label k + 1."""

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""Corners of a tetrahedron's edges, in VTK's order of the nodes on their middles."""


@dataclass(frozen=True)
class MeshPort:
    """A flat opening of a lumen.

    Attributes
    ----------
    node : int
        Of the network; -1 where the lumen has none.
    centre : (3,) float64, mm
    outward : (3,) float64
        Unit normal, out of the lumen.
    radius_mm : float, mm
        Of the circle of its area.
    inlet : bool
        Flow comes in there, as designed.
    """

    node: int
    centre: FloatArray
    outward: FloatArray
    radius_mm: float
    inlet: bool


@dataclass(frozen=True)
class LumenMesh:
    """Quadratic tetrahedra that fill a lumen, its wall and its ports.

    Attributes
    ----------
    points : (n + e, 3) float64, mm
        Corners first, then a node for each edge: its middle, or where the wall is curved what
        makes the edge follow it.
    tets : (t, 10) int64
        Corners, then edges in the order of `EDGES` (VTK's quadratic tetrahedron). Positively
        oriented: (p1 - p0) x (p2 - p0) . (p3 - p0) > 0.
    corner_count : int
        n.
    faces : (f, 6) int64
        Boundary triangles: corners, outward by the right hand, then the nodes on the edges
        between the first and second, second and third, third and first.
    label : (f,) int64
        `WALL`, or k + 1 for port k.
    ports : tuple of MeshPort
    """

    points: FloatArray
    tets: IntArray
    corner_count: int
    faces: IntArray
    label: IntArray
    ports: tuple[MeshPort, ...]
