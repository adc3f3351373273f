"""Convert tissue surfaces to and from manifold3d, for booleans."""

from __future__ import annotations

import numpy as np
from manifold3d import Error, Manifold, Mesh64
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.closed import edges_of, merge_vertices

_STEPS_APART = 8.0
_ROUNDS = 6
_COARSER = 4.0


def manifold_of(surface: Surface, what: str) -> Manifold:
    """Hand a surface to manifold3d.

    Raises
    ------
    TissueError
        When ``what`` isn't a closed, oriented 2-manifold.
    """
    return distinct_manifold(Surface(*merge_vertices(surface.vertices, surface.faces)), what)


def distinct_manifold(surface: Surface, what: str) -> Manifold:
    """As `manifold_of`, for a surface without two vertices in one place."""
    points, faces = np.ascontiguousarray(surface.vertices), surface.faces
    manifold = Manifold(Mesh64(points, np.ascontiguousarray(faces, dtype=np.uint64)))
    if manifold.status() != Error.NoError:
        edges = edges_of(faces)
        raise TissueError(
            f"{what} can't be cut or united: {int((edges.uses != 2).sum())} of {len(edges.uses)} "
            f"edges don't have two faces ({manifold.status().name}); mend the mesh"
        )
    return manifold


def surface_of(manifold: Manifold, what: str, touching: bool = False) -> Surface:
    """The surface of a boolean's result, rounded to float32 without opening it.

    Files of meshes hold float32; a surface that is so already is the same in the file. Vertices
    closer together than its steps are merged first, at 8 steps of the greatest coordinate, and
    up to 4^5 times as much if that leaves edges with four faces; with ``touching`` such edges, in
    which parts touch, may stay.

    Raises
    ------
    TissueError
        When ``what`` is empty or doesn't stay closed.
    """
    if manifold.is_empty():
        raise TissueError(f"nothing is left of {what}")
    greatest = np.abs(np.array(manifold.bounding_box())).max()
    step = _STEPS_APART * float(np.spacing(np.float32(greatest)))
    for _ in range(_ROUNDS):
        rounded = _rounded(manifold.simplify(step))
        if rounded is not None:
            return rounded
        step *= _COARSER
    if touching and (rounded := _rounded(manifold, touching)) is not None:
        return rounded
    raise TissueError(
        f"{what} doesn't stay closed when rounded to float32: parts of it touch in an edge or a "
        "point; move them apart or let them overlap"
    )


def _rounded(manifold: Manifold, touching: bool = False) -> Surface | None:
    """The surface in float32, or None where that has edges without two (four) faces."""
    vertices, faces = arrays_of(manifold)
    # Adding 0 turns -0 into 0: they are one place.
    near = vertices.astype(np.float32).astype(np.float64) + 0.0
    points, corners = merge_vertices(near, faces)
    edges = edges_of(corners)
    fits = edges.uses % 2 == 0 if touching else edges.uses == 2
    if len(corners) and fits.all() and not edges.turned:
        return Surface(points, corners)
    return None


def arrays_of(manifold: Manifold) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices (n, 3), mm, and faces (m, 3)."""
    mesh = manifold.to_mesh64()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return np.ascontiguousarray(vertices), np.asarray(mesh.tri_verts, dtype=np.int32)
