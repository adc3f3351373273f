"""Constructs: a body, minus its lumens, minus the marks that make its pose unambiguous."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.solids.facets import FACET_TOLERANCE_MM, facet_count
from design.solids.manifolds import solid_manifold, subtract, to_manifold
from design.solids.merge import merge_equal
from design.solids.snap import solid_from_manifold, solid_from_mesh
from design.solids.solid import Solid

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
    merged, triangles, manifold = _checked(vertices, faces)
    return solid_from_mesh(merged, triangles, "the tissue's surface", manifold)


def sections_solid(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Solid:
    """Make a solid for sections alone of a closed, oriented surface: with the file's own vertices.

    Sheets that touch, or faces that cross, are left: sections don't mind them, files that are
    written do. Parameters and errors are those of `solid_from_surface`.
    """
    merged, triangles, _ = _checked(vertices, faces)
    return Solid(merged, triangles.astype(np.int32))


def _checked(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.int64], Manifold]:
    """Equal vertices merged, collapsed faces dropped; and the manifold that it is."""
    merged, index = merge_equal(np.asarray(vertices, np.float64))
    triangles = index[np.asarray(faces)]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    manifold = to_manifold(merged, triangles, "the tissue's surface")
    volume = manifold.volume()
    if volume <= 0:
        raise SolidError(
            f"the tissue's surface encloses {volume:g} mm³: it is inside out; reverse its faces"
        )
    return merged, triangles, manifold


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
    tools = [] if lumen is None else [solid_manifold(lumen, "the lumens' solid")]
    for centre, diameter in dimples:
        if not diameter > 0.0:
            raise SolidError(f"dimple of {diameter:g} mm; give a diameter above 0")
        radius = 0.5 * float(diameter)
        ball = Manifold.sphere(radius, facet_count(radius, FACET_TOLERANCE_MM))
        tools.append(ball.translate(np.asarray(centre, dtype=np.float64).tolist()))
    return solid_from_manifold(subtract(solid_manifold(body, "the body"), tools), "the construct")
