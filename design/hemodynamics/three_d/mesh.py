"""Mesh a network's lumens with curved tetrahedra, a port at each free end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.axes import axis_places
from design.hemodynamics.three_d.curve import curve_edges
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.surface import wall_surface
from design.hemodynamics.three_d.surface_check import check_surface
from design.hemodynamics.three_d.volume import fill
from design.hemodynamics.three_d.wall import lumen_wall
from design.network import VesselNetwork

INSIDE: Final = 0.6
"""Longest edge on a vessel's axis over that on its wall. Measured on the planar network: flat
elements that fold when curved fall from 2,560 of 13,365 to 9 of 8,989, with fewer elements."""

_COARSEST: Final = 0.7
"""Edge ratio from which on the inside isn't made coarser: elements with all corners on the wall
fold, and straightening them takes 1 to 4 % of a fork's volume and adds 3 to 13 % to its resistance
(edge ratios 0.8 to 1); so, it is 0.1 % and 0.6 %."""


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
        free end that another vessel runs into, for a fillet without room, and when Netgen finds
        no mesh or isn't installed.
    SolidError
        When the lumens can't be united.
    """
    options = options or MeshOptions()
    if not np.any(network.degree() == 1):
        raise FlowError("the network has no free ends, so nothing flows in or out; give it some")
    wall = lumen_wall(network, options.fillet_ratio, options.edge_ratio)
    surface = wall_surface(network, wall, options.fillet_ratio)
    check_surface(surface, wall, options.fillet_ratio)
    spacing = INSIDE * min(options.edge_ratio, _COARSEST)
    inside, size, _ = axis_places(network, spacing)
    points, tets = fill(surface, inside, size, options.growth)
    return curve_edges(surface, points, tets, wall, wall.ports)
