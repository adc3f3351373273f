"""Fill a closed triangulated surface with tetrahedra, by Netgen."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.errors import FlowError
from design.solids.remesh import LabelledSurface
from kernels.arrays import FloatArray, IntArray

_COARSE = 2.0
"""Longest edge inside, over the longest on the surface."""


def fill(
    surface: LabelledSurface, inside: FloatArray, size: FloatArray, growth: float
) -> tuple[FloatArray, IntArray]:
    """Points (n, 3), those of the surface first, and positively oriented tetrahedra (t, 4).

    Parameters
    ----------
    surface : LabelledSurface
    inside : (k, 3) float64, mm
        Places where edges aren't to be longer than ``size`` (k,), mm. On the vessels' axes they
        give every wall triangle an inner corner of its own: a tetrahedron with all corners on
        the wall is flat, and folds when its edges are bent.
    growth : float
        Netgen's grading: how fast edges may grow, 0 to 1.

    Raises
    ------
    FlowError
        When Netgen finds no mesh, or isn't installed.
    """
    meshing = _netgen()
    mesh = _bounded(meshing, surface)
    mesh.CalcLocalH(growth, 1)
    for (x, y, z), h in zip(inside.tolist(), size.tolist(), strict=True):
        mesh.RestrictLocalH(meshing.Pnt(x, y, z), h)
    edges = surface.vertices[surface.faces] - surface.vertices[surface.faces[:, [1, 2, 0]]]
    longest = _COARSE * float(np.linalg.norm(edges, axis=2).max())
    try:
        mesh.GenerateVolumeMesh(maxh=longest, grading=growth)
    except Exception as exc:  # Netgen raises its own kind, with no more than a line.
        raise FlowError(f"Netgen found no tetrahedra between the walls: {exc}") from exc
    points = np.array(mesh.Coordinates())  # A view of memory that goes with the mesh.
    tets = _corners(mesh.Elements3D())
    if len(tets) == 0:
        raise FlowError("Netgen found no tetrahedra between the walls; try another mesh size")
    if not np.array_equal(points[: len(surface.vertices)], surface.vertices):
        raise FlowError("Netgen moved the wall; try another mesh size")
    return points, _oriented(points, tets)


def _netgen() -> Any:
    try:
        from netgen import meshing
    except ImportError as exc:
        raise FlowError(
            "3D flow needs the mesh generator Netgen, which isn't installed; "
            "pip install 'printctl[flow3d]', or stay with 0D and 1D"
        ) from exc
    meshing.SetMessageImportance(0)
    return meshing


def _bounded(meshing: Any, surface: LabelledSurface) -> Any:
    """A Netgen mesh that holds the surface alone."""
    mesh = meshing.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(surface.vertices))
    for label in range(int(surface.label.max()) + 1):
        descriptor = meshing.FaceDescriptor(surfnr=label + 1, domin=1, domout=0, bc=label + 1)
        number = mesh.Add(descriptor)
        mine = surface.faces[surface.label == label]
        if len(mine):
            mesh.AddElements(dim=2, index=number, data=mine.astype(np.int32), base=0)
    return mesh


def _corners(elements: Any) -> IntArray:
    """Numbers of the corners of Netgen's tetrahedra, from 0, (t, 4)."""
    table = elements.NumPy()
    return np.asarray(table["nodes"][:, :4], dtype=np.int64) - 1


def _oriented(points: FloatArray, tets: IntArray) -> IntArray:
    edge = points[tets[:, 1:]] - points[tets[:, :1]]
    turned = np.einsum("ij,ij->i", np.cross(edge[:, 0], edge[:, 1]), edge[:, 2]) < 0.0
    tets = tets.copy()
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]
    return tets
