"""Mesh a lumen given as a surface (scanned, or made by booleans) with curved tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.geometry.crossings import find_crossings
from design.hemodynamics.three_d.axes import axis_places
from design.hemodynamics.three_d.curve import curve_edges
from design.hemodynamics.three_d.cut_ends import cut_ends
from design.hemodynamics.three_d.facets import facet_wall
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.mesh import INSIDE
from design.hemodynamics.three_d.volume import fill
from design.hemodynamics.three_d.wall import free_ends
from design.network import VesselNetwork
from design.solids.denoise import denoised
from design.solids.remesh import LabelledSurface, remesh
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class SurfaceOptions:
    """How fine a lumen's surface is meshed, and whether its noise is taken off.

    Attributes
    ----------
    edge_ratio : float
        Length of an edge on the wall over the lumen's radius in the network.
    growth : float
        How fast edges may grow away from the wall, 0 to 1.
    smooth_passes : int
        Of `denoised`; 0 for a surface that is meant as it is.
    """

    edge_ratio: float = 0.5
    growth: float = 0.3
    smooth_passes: int = 0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("edge_ratio", 0.1, 1.2),
            ("growth", 0.05, 1.0),
            ("smooth_passes", 0, 1000),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise FlowError(f"{name} {value:g} of a 3D mesh: give {low:g} to {high:g}")


def surface_mesh(
    vertices: FloatArray,
    faces: IntArray,
    network: VesselNetwork,
    options: SurfaceOptions | None = None,
) -> LumenMesh:
    """Mesh the lumen inside a closed surface, a port at each of the network's free ends.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
        In the network's frame.
    faces : (f, 3) integer
        Outward by the right hand. The surface is cut square to the vessels at the free ends, and
        so has to reach them; it may go on beyond.
    network : VesselNetwork
        Where it ends, and about how wide it is where.
    options : SurfaceOptions, optional

    Raises
    ------
    FlowError
        When the network has no free ends, the surface doesn't reach one or is interrupted, and
        when Netgen finds no mesh or isn't installed.
    SolidError
        When the surface isn't closed.
    """
    options = options or SurfaceOptions()
    ends = free_ends(network)
    if not ends:
        raise FlowError("the network has no free ends, so nothing flows in or out; give it some")
    points = denoised(np.asarray(vertices, dtype=np.float64), faces, options.smooth_passes)
    cut = cut_ends(points, np.asarray(faces, dtype=np.int64), ends)
    wall = facet_wall(cut.wall, network, cut.ports, options.edge_ratio)
    surface = remesh(cut.surface, wall)
    _check(surface, network)
    inside, size, _ = axis_places(network, INSIDE * options.edge_ratio)
    filled, tets = fill(surface, inside, size, options.growth)
    return curve_edges(surface, filled, tets, wall, cut.ports)


def _check(surface: LabelledSurface, network: VesselNetwork) -> None:
    """Refuse what would bring Netgen down, and with it the process: triangles through others."""
    crossing = find_crossings(surface.vertices, surface.faces).pairs
    if len(crossing):
        place = surface.vertices[surface.faces[crossing[0, 0]]].mean(axis=0)
        near = int(np.argmin(np.linalg.norm(network.nodes - place, axis=1)))
        raise FlowError(
            f"{len(crossing)} triangles of the lumen's remade surface pass through others, one at "
            f"({', '.join(f'{x:.4g}' for x in place)}) mm (nearest node: {near}); take noise off "
            "(more smooth_passes), or give a smaller edge_ratio"
        )
