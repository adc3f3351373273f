"""Triangulate the walls and ports of a network's lumens with even triangles."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.hemodynamics.three_d.lumen_mesh import WALL, MeshPort
from design.hemodynamics.three_d.wall import LumenWall
from design.network import VesselNetwork
from design.solids.lumen import lumen_solid
from design.solids.remesh import LabelledSurface, remesh
from kernels.arrays import FloatArray, IntArray

_ROUGH: Final = 0.03
"""Of the thinnest radius: how far the surface to begin with is from round."""

_FLAT: Final = 1e-5
"""Radii that an end is drawn out by, so that it is cut flat."""


def wall_surface(network: VesselNetwork, wall: LumenWall, fillet_ratio: float) -> LabelledSurface:
    """Triangulate the lumens of ``network``, with a rim around every port.

    It begins with a solid of the wall's own fillets: the sharp seam of vessels that part at an
    acute angle lies radii away from its fillet, and would fold on the way there.
    Labels are those of `LumenMesh`.

    Raises
    ------
    SolidError
        For a network whose lumens can't be united.
    """
    thinnest = float(network.radius.min())
    nodes = np.array([port.node for port in wall.ports], dtype=np.int64)
    solid = lumen_solid(
        network,
        extend_ends_mm=_FLAT * np.array([port.radius_mm for port in wall.ports]),
        extend_nodes=nodes,
        tolerance_mm=_ROUGH * thinnest,
        fillet_ratio=fillet_ratio,
    )
    points, faces = solid.vertices.astype(np.float64), solid.faces.astype(np.int64)
    rough = LabelledSurface(points, faces, _labels(points, faces, wall.ports))
    return remesh(rough, wall)


def _labels(points: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]) -> IntArray:
    label = np.full(len(faces), WALL)
    for k, port in enumerate(ports):
        away = points - port.centre
        height = np.abs(away @ port.outward)
        near = np.linalg.norm(away, axis=1) < 1.2 * port.radius_mm
        on = near & (height < 20.0 * _FLAT * port.radius_mm)
        label[on[faces].all(axis=1)] = k + 1
    return label
