"""Make solids of a cylinder, or of an open bioreactor chamber."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from design.errors import SolidError
from design.solids.chamber import Chamber
from design.solids.facets import FACET_TOLERANCE_MM, area_factor, facet_count
from design.solids.manifolds import subtract, unite
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid


def cylinder_solid(diameter_mm: float, height_mm: float) -> Solid:
    """Upright cylinder of the circle's area, its axis on z, from z = 0.

    Raises
    ------
    SolidError
        When a length isn't above 0.
    """
    if not (0.0 < diameter_mm < np.inf and 0.0 < height_mm < np.inf):
        raise SolidError(f"cylinder of {diameter_mm:g} x {height_mm:g} mm; give lengths above 0")
    return solid_from_manifold(_cylinder(0.5 * diameter_mm, height_mm), "the cylinder")


def chamber_solid(chamber: Chamber) -> Solid:
    """A bioreactor's body, its inside's floor centred on the origin, open towards +z.

    Ports are added to it by `with_connector`.

    Raises
    ------
    SolidError
        When a length isn't above 0, or the ledge doesn't fit the wall.
    """
    lengths = [*chamber.inner_mm, chamber.wall_mm, chamber.floor_mm]
    if not all(0.0 < length < np.inf for length in lengths):
        raise SolidError(f"{chamber}: give lengths above 0")
    wall, height = chamber.wall_mm, chamber.inner_mm[2]
    if not 0.0 <= chamber.ledge_mm < wall:
        raise SolidError(f"ledge_mm {chamber.ledge_mm:g} must be below wall_mm {wall:g}")
    if chamber.ledge_mm and not 0.0 < chamber.ledge_depth_mm < height:
        raise SolidError(
            f"ledge_depth_mm {chamber.ledge_depth_mm:g} must be above 0 and below the inner "
            f"height, {height:g} mm"
        )
    outside = _prism(chamber, wall, height + chamber.floor_mm).translate([0, 0, -chamber.floor_mm])
    # The inside goes 1 mm beyond the rim, so that no two faces coincide.
    inside = _prism(chamber, 0.0, height + 1.0)
    if chamber.ledge_mm:
        step = _prism(chamber, chamber.ledge_mm, chamber.ledge_depth_mm + 1.0)
        inside = unite([inside, step.translate([0, 0, height - chamber.ledge_depth_mm])])
    return solid_from_manifold(subtract(outside, [inside]), "the chamber")


def _prism(chamber: Chamber, beyond: float, height: float) -> Manifold:
    """The chamber's inner outline, widened by ``beyond`` on each side, from z = 0."""
    width, depth, _ = chamber.inner_mm
    if chamber.shape == "cylinder":
        return _cylinder(0.5 * width + beyond, height)
    size = [width + 2.0 * beyond, depth + 2.0 * beyond, height]
    return Manifold.cube(size).translate([-0.5 * size[0], -0.5 * size[1], 0.0])


def _cylinder(radius: float, height: float) -> Manifold:
    facets = facet_count(radius, FACET_TOLERANCE_MM)
    return Manifold.cylinder(height, radius * area_factor(facets), circular_segments=facets)
