"""Convert meshes to manifold3d; unite them, or subtract some from a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import Error, Manifold, Mesh64, OpType
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.mesh import merge_vertices
from design.solids.solid import Solid
from design.solids.topology import edge_faults, is_closed
from kernels.arrays import FloatArray


def to_manifold(vertices: FloatArray, faces: NDArray[np.integer], what: str) -> Manifold:
    """Hand a closed mesh to manifold3d.

    Raises
    ------
    SolidError
        When ``what`` isn't a closed, oriented 2-manifold.
    """
    mesh = Mesh64(
        np.ascontiguousarray(vertices, dtype=np.float64),
        np.ascontiguousarray(faces, dtype=np.uint64),
    )
    manifold = Manifold(mesh)
    if manifold.status() != Error.NoError:
        raise SolidError(f"{what} isn't a closed, oriented surface: {_fault(faces, manifold)}")
    return manifold


def solid_manifold(solid: Solid, what: str) -> Manifold:
    """Hand a `Solid` to manifold3d."""
    return to_manifold(solid.vertices, solid.faces, what)


def unite(parts: Sequence[Manifold]) -> Manifold:
    """Union of all ``parts`` in one batch, whose order of work doesn't depend on threads."""
    return Manifold.batch_boolean(list(parts), OpType.Add)


def subtract(body: Manifold, tools: Sequence[Manifold]) -> Manifold:
    """``body`` without any of ``tools``."""
    return Manifold.batch_boolean([body, *tools], OpType.Subtract)


def _fault(faces: NDArray[np.integer], manifold: Manifold) -> str:
    faults = edge_faults(faces)
    if faults.open:
        return f"{faults.open} open edges; close the holes"
    if faults.wrong:
        return f"{faults.wrong} edges with several or opposed faces; mend or re-export the mesh"
    return f"{manifold.status().name}; mend the mesh"


_SURFACE = "the tissue's surface"


def sections_solid(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Solid:
    """Make a solid for sections alone of a closed, oriented surface: with the file's own vertices.

    Sheets that touch, or faces that cross, are left: sections don't mind them, files that are
    written do. Parameters and errors are those of `design.solids.construct.solid_from_surface`.
    """
    merged, triangles = merge_vertices(vertices, faces)
    if not is_closed(triangles, touching=True):
        to_manifold(merged, triangles, _SURFACE)  # raises the error
    solid = Solid(merged, triangles.astype(np.int32))
    _check_volume(solid.volume_mm3)
    return solid


def checked_surface(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.int64], Manifold]:
    """Equal vertices merged, collapsed faces dropped; and the manifold that it is."""
    merged, triangles = merge_vertices(vertices, faces)
    manifold = to_manifold(merged, triangles, _SURFACE)
    _check_volume(manifold.volume())
    return merged, triangles, manifold


def _check_volume(volume_mm3: float) -> None:
    if volume_mm3 <= 0:
        raise SolidError(
            f"{_SURFACE} encloses {volume_mm3:g} mm³: it is inside out; reverse its faces"
        )
