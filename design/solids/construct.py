"""Build a construct: a body (block, cylinder, chamber) minus its lumens and marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.solids.dimensions import Chamber
from design.solids.local_subtract import subtract_near
from design.solids.manifolds import checked_surface, solid_manifold, subtract, unite
from design.solids.snap import solid_from_manifold, solid_from_mesh
from design.solids.solid import Solid
from design.solids.tube import FACET_TOLERANCE_MM, area_factor, facet_count

MIN_LOCAL_FACES = 50_000
"""Faces of a lumen from which on most of a boolean is saved where it is done near ports alone."""
Vector = Sequence[float] | NDArray[np.float64]


def block_solid(size: Vector, origin: Vector = (0.0, 0.0, 0.0)) -> Solid:
    """Axis-parallel block of ``size`` (3,) mm with its lowest corner at ``origin`` (3,) mm.

    Raises
    ------
    SolidError
        When a side isn't above 0.
    """
    sides = np.asarray(size, dtype=np.float64)
    if sides.shape != (3,) or not np.all(np.isfinite(sides) & (sides > 0)):
        raise SolidError(f"block of {sides.tolist()} mm; give three sides above 0")
    cube = Manifold.cube(sides.tolist()).translate(np.asarray(origin, dtype=np.float64).tolist())
    return solid_from_manifold(cube, "the block")


def solid_from_surface(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Solid:
    """Solid of a tissue's surface.

    Parameters
    ----------
    vertices : (n, 3), mm
    faces : (m, 3)
        Outward; equal vertices are merged.

    Raises
    ------
    SolidError
        When the surface isn't closed and oriented, or is inside out.
    """
    merged, triangles, manifold = checked_surface(vertices, faces)
    return solid_from_mesh(merged, triangles, "the tissue's surface", manifold)


def construct_solid(
    body: Solid, lumen: Solid | None, dimples: Sequence[tuple[Vector, float]] = ()
) -> Solid:
    """``body`` minus ``lumen`` minus spherical ``dimples``.

    A dimple's ball is centred on the face it marks, so that a half of it is cut away.

    Parameters
    ----------
    body : Solid
    lumen : Solid, optional
        Its ends must pass through the body's faces to open there (`lumen_solid`'s
        ``extend_ends_mm``).
    dimples : sequence of (centre (3,) mm, diameter mm)

    Raises
    ------
    SolidError
        When a dimple's diameter isn't above 0, or nothing is left of the body.
    """
    if lumen is not None and not dimples and len(lumen.faces) >= MIN_LOCAL_FACES:
        local = subtract_near(body, lumen, "the construct")
        if local is not None:
            return local
    tools = [] if lumen is None else [solid_manifold(lumen, "the lumens' solid")]
    for centre, diameter in dimples:
        if not diameter > 0.0:
            raise SolidError(f"dimple of {diameter:g} mm; give a diameter above 0")
        radius = 0.5 * float(diameter)
        ball = Manifold.sphere(radius, facet_count(radius, FACET_TOLERANCE_MM))
        tools.append(ball.translate(np.asarray(centre, dtype=np.float64).tolist()))
    return solid_from_manifold(subtract(solid_manifold(body, "the body"), tools), "the construct")


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
