"""A network's lumens as curved tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.curve import curved
from design.hemodynamics.three_d.lumen_mesh import LumenMesh, MeshPort
from design.hemodynamics.three_d.surface import wall_surface
from design.hemodynamics.three_d.volume import fill
from design.hemodynamics.three_d.wall import lumen_wall
from design.network import FloatArray, VesselNetwork
from design.solids.remesh import LabelledSurface

_INSIDE: Final = 0.6
"""Longest edge on a vessel's axis over that on its wall. Measured on the planar network: flat
elements that fold when curved fall from 2,560 of 13,365 to 9 of 8,989, with fewer elements."""

_COARSEST: Final = 0.7
"""Edge ratio from which on the inside isn't made coarser: elements with all corners on the wall
fold, and straightening them takes 1 to 4 % of a fork's volume and adds 10 to 20 % to its resistance
(edge ratios 0.8 to 1); so, it is 0.1 % and 1 %."""

_LEAST_PORT: Final = 0.6
"""Of a circle's area: a port of straight edges has 0.83 of it, or more (edge ratio 1)."""


@dataclass(frozen=True)
class MeshOptions:
    """How fine a lumen is meshed, and how its junctions are rounded.

    Attributes
    ----------
    edge_ratio : float
        Length of an edge on the wall over the lumen's radius.
    fillet_ratio : float
        Radius of the fillet at a junction over that of its thinnest vessel.
    growth : float
        How fast edges may grow away from the wall, 0 to 1.
    """

    edge_ratio: float = 0.7
    fillet_ratio: float = 0.5
    growth: float = 0.3

    def __post_init__(self) -> None:
        for name, low, high in (
            ("edge_ratio", 0.1, 1.0),
            ("fillet_ratio", 0.05, 2.0),
            ("growth", 0.05, 1.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise FlowError(f"{name} {value:g} of a 3D mesh: give {low:g} to {high:g}")


def lumen_mesh(network: VesselNetwork, options: MeshOptions | None = None) -> LumenMesh:
    """Mesh a network's lumens, a port at each of its free ends.

    Parameters
    ----------
    network : VesselNetwork
    options : MeshOptions, optional

    Raises
    ------
    FlowError
        When nothing can flow through (no free ends), for vessels of no length or radius, for a
        free end that another vessel runs into, and when Netgen finds no mesh or isn't installed.
    SolidError
        When the lumens can't be united.
    """
    options = options or MeshOptions()
    if not np.any(network.degree() == 1):
        raise FlowError("the network has no free ends, so nothing flows in or out; give it some")
    wall = lumen_wall(network, options.fillet_ratio, options.edge_ratio)
    surface = wall_surface(network, wall)
    _check_ports(surface, wall.ports)
    inside, size = _axes(network, _INSIDE * min(options.edge_ratio, _COARSEST))
    points, tets = fill(surface, inside, size, options.growth)
    return curved(surface, points, tets, wall, wall.ports)


def _check_ports(surface: LabelledSurface, ports: tuple[MeshPort, ...]) -> None:
    """Refuse ports that aren't the discs they are meant to be."""
    corner = surface.points[surface.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.bincount(
        surface.label, 0.5 * np.linalg.norm(across, axis=1), minlength=len(ports) + 1
    )
    for k, port in enumerate(ports):
        found, disc = float(area[k + 1]), np.pi * port.radius_mm**2
        if not _LEAST_PORT * disc < found < disc * (1.0 + 1e-6):
            x, y, z = port.centre
            raise FlowError(
                f"the free end at node {port.node} ({x:.3f}, {y:.3f}, {z:.3f} mm) isn't an open "
                f"disc: {found:.3g} of {disc:.3g} mm²; another vessel runs into it, or it is "
                "shorter than it is wide: draw it out, or move it"
            )


def _axes(network: VesselNetwork, ratio: float) -> tuple[FloatArray, FloatArray]:
    """Places along the axes, ``ratio`` radii apart, and that distance at each, mm."""
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.ceil(length / (ratio * np.minimum(r0, r1))).astype(np.int64)
    piece = np.repeat(np.arange(len(start)), count)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    t = ((step + 0.5) / count[piece])[:, None]
    radius = (1.0 - t[:, 0]) * r0[piece] + t[:, 0] * r1[piece]
    return (1.0 - t) * start[piece] + t * end[piece], ratio * radius
