"""Build a construct: a body minus its lumens, minus dimples that mark its pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.solids.facets import FACET_TOLERANCE_MM, facet_count
from design.solids.local_subtract import subtract_near
from design.solids.manifolds import solid_manifold, subtract
from design.solids.snap import solid_from_manifold, solid_from_mesh
from design.solids.solid import Solid
from design.solids.surface import checked_surface

_LARGE = 50_000
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
    if lumen is not None and not dimples and len(lumen.faces) >= _LARGE:
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
