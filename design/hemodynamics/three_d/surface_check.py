"""Check a lumen's triangulated wall against the intended network before meshing its inside."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.errors import FlowError
from design.geometry.crossings import find_crossings
from design.hemodynamics.three_d.lumen_mesh import WALL, MeshPort
from design.hemodynamics.three_d.wall import LumenWall
from design.solids.remesh import LabelledSurface
from kernels.arrays import FloatArray

_OFF: Final = 0.01
"""Of the lumen's radius: how far a vertex may be off the wall. Where all is well it is 1e-5."""

_LEAST_PORT: Final = 0.6
"""Of a circle's area: a port of straight edges has 0.83 of it, or more (edge ratio 1)."""


def check_surface(surface: LabelledSurface, wall: LumenWall, fillet_ratio: float) -> None:
    """Refuse a surface that isn't the wall's, that crosses itself, or whose ports aren't open.

    Raises
    ------
    FlowError
    """
    _check_ports(surface, wall.ports)
    vertices = surface.vertices[np.unique(surface.faces[surface.label == WALL])]
    off = np.abs(wall.distance(vertices)) / (wall.size(vertices) / wall.ratio)
    worst = int(np.argmax(off))
    if off[worst] > _OFF:
        raise FlowError(
            f"the lumen's wall can't be followed {_near(vertices[worst])}: the fillet there has no "
            f"room between vessels; lower the fillet ratio ({fillet_ratio:g}) to a third, take a "
            f"smaller edge ratio ({wall.ratio:g}), or move vessels apart"
        )
    crossing = find_crossings(surface.vertices, surface.faces).pairs
    if len(crossing):
        place = surface.vertices[surface.faces[crossing[0, 0]]].mean(axis=0)
        raise FlowError(
            f"the lumen's wall crosses itself {_near(place)} ({len(crossing)} pairs of triangles): "
            f"vessels nearly touch there without being joined; lower the fillet ratio "
            f"({fillet_ratio:g}), take a smaller edge ratio ({wall.ratio:g}), or move them apart"
        )


def _near(place: FloatArray) -> str:
    x, y, z = place
    return f"near {x:.3f}, {y:.3f}, {z:.3f} mm"


def _check_ports(surface: LabelledSurface, ports: tuple[MeshPort, ...]) -> None:
    """Refuse ports that aren't the discs they are meant to be."""
    corner = surface.vertices[surface.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.bincount(
        surface.label, 0.5 * np.linalg.norm(across, axis=1), minlength=len(ports) + 1
    )
    for k, port in enumerate(ports):
        face_area, disc = float(area[k + 1]), np.pi * port.radius_mm**2
        if not _LEAST_PORT * disc < face_area < disc * (1.0 + 1e-6):
            x, y, z = port.centre
            raise FlowError(
                f"the free end at node {port.node} ({x:.3f}, {y:.3f}, {z:.3f} mm) isn't an open "
                f"disc: {face_area:.3g} of {disc:.3g} mm²; another vessel runs into it, or it is "
                "shorter than it is wide: draw it out, or move it"
            )
