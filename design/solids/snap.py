"""Round a solid's vertices to float32 and keep its surface closed.

STL and most readers hold float32. Vertices of a boolean's result may lie closer together than
its steps: written as they are, they fall onto one another, and the file read back has edges with
four faces. So: simplify below the steps, round, merge what coincides, drop what collapsed, draw
apart sheets that merely touch, and look again. Then take away what crosses (`mend`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.crossings import find_crossings
from design.geometry.mesh import merge_distances, without_collapsed
from design.solids.manifolds import to_manifold
from design.solids.repair.mend import mend_surface
from design.solids.solid import Solid
from design.solids.topology import edge_faults, faulty_vertices, is_closed
from design.solids.tube import FACET_TOLERANCE_MM
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int64]

MEND_FACETS = 4.0
"""Facet tolerances by which one change that mends crossings may move the surface: with 1, a few
places in half a million stay crossed where several vessels meet in wedges."""


def solid_from_manifold(manifold: Manifold, what: str, *, mend: bool = True) -> Solid:
    """Round to float32 such that the surface stays closed.

    For each of `merge_distances` in turn, simplify within it, and draw vertices at which two sheets
    touch into the solid by as much. With ``mend`` crossings are taken away afterwards.

    Raises
    ------
    SolidError
        When ``what`` is empty, or can't be kept closed by any of these.
    """
    if manifold.is_empty():
        raise SolidError(f"{what} is empty; nothing is left of the shape")
    for step in merge_distances(np.array(manifold.bounding_box())):
        mesh = manifold.simplify(step).to_mesh64()
        vertices, faces = mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int64)
        snapped, kept = snap_mesh(vertices, faces)
        faults = edge_faults(kept)
        if faults:
            snapped, kept = snap_mesh(_draw_apart(vertices, faces, step), faces)
            faults = edge_faults(kept)
        if len(kept) and not faults:
            solid = Solid(snapped, kept.astype(np.int32))
            return mended_solid(solid)[0] if mend else solid
    raise SolidError(
        f"{what}: {faults.open + faults.wrong} edges don't stay closed when rounded to float32: "
        "parts touch in an edge or a point; move them apart or let them overlap"
    )


def solid_from_mesh(
    vertices: FloatArray,
    faces: FaceArray,
    what: str,
    manifold: Manifold | None = None,
    *,
    mend: bool = True,
) -> Solid:
    """Round a closed mesh to float32; as it is where that leaves it closed.

    ``manifold`` is the same mesh where it has been made already; ``mend`` as there.

    Raises
    ------
    SolidError
        When it isn't closed and oriented, or can't be kept so (see `solid_from_manifold`).
    """
    snapped, kept = snap_mesh(vertices, faces)
    if len(kept) and is_closed(kept):
        return Solid(snapped, kept.astype(np.int32))
    if len(kept):
        # Where a few vertices alone touch, all others stay as they are.
        step = next(merge_distances(vertices))
        snapped, kept = snap_mesh(_draw_apart(vertices, faces, step), faces)
        if is_closed(kept):
            solid = Solid(snapped, kept.astype(np.int32))
            return mended_solid(solid)[0] if mend else solid
    if manifold is not None:
        return solid_from_manifold(manifold, what, mend=mend)
    used, renumbered = np.unique(faces, return_inverse=True)
    manifold = to_manifold(vertices[used], renumbered.reshape(-1, 3), what)
    return solid_from_manifold(manifold, what, mend=mend)


def mended_solid(
    solid: Solid, tolerance_mm: float = FACET_TOLERANCE_MM
) -> tuple[Solid, NDArray[np.int64]]:
    """A solid with as few crossing faces as small changes leave, and the numbers of these.

    One change may move the surface by `MEND_FACETS` facet tolerances at most, or the first of
    `merge_distances` where that is more.
    """
    step = next(merge_distances(solid.vertices))
    faces = solid.faces.astype(np.int64)
    vertices, faces, left = mend_surface(
        solid.vertices, faces, max(MEND_FACETS * tolerance_mm, step)
    )
    if vertices is solid.vertices:
        return replace(solid, uncrossed=len(left) == 0), left
    used, faces = np.unique(faces, return_inverse=True)
    mended = Solid(vertices[used], faces.reshape(-1, 3).astype(np.int32))
    if len(left) and not is_closed(snap_mesh(mended.vertices, mended.faces.astype(np.int64))[1]):
        # Vertices that cross still may have come to one place: better as it was.
        return solid, find_crossings(solid.vertices, solid.faces).faces
    return mended, left


def snap_mesh(vertices: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray]:
    """Round to float32, merge equal vertices, drop triangles that collapsed to an edge."""
    places, index = _places(vertices)
    faces = without_collapsed(index[faces])
    used = np.zeros(len(places), dtype=bool)
    used[faces] = True
    return places[used].astype(np.float64), (np.cumsum(used) - 1)[faces]


def _places(vertices: FloatArray) -> tuple[NDArray[np.float32], FaceArray]:
    """Distinct float32 positions, and which of them each vertex has."""
    rounded = vertices.astype(np.float32) + np.float32(0.0)  # -0 and 0 are one place
    bits = rounded.view(np.int32).astype(np.int64)
    order = np.lexsort((bits[:, 2], (bits[:, 0] << 32) + bits[:, 1]))
    ordered = rounded[order]
    fresh = np.ones(len(ordered), dtype=bool)
    fresh[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    index = np.empty(len(ordered), dtype=np.int64)
    index[order] = np.cumsum(fresh) - 1
    return ordered[fresh], index


def _draw_apart(vertices: FloatArray, faces: FaceArray, step: float) -> FloatArray:
    """Vertices that merging would put on a faulty edge, moved into the solid by ``step``.

    Sheets that touch face one another there (a gap or two bodies), so each goes its own way.
    """
    _, index = _places(vertices)
    twin = np.bincount(index)[index] > 1
    moved = np.flatnonzero(twin & np.isin(index, faulty_vertices(without_collapsed(index[faces]))))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.zeros_like(vertices)
    np.add.at(normal, faces.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    length = np.linalg.norm(normal[moved], axis=1, keepdims=True)
    apart = vertices.copy()
    apart[moved] -= step * normal[moved] / np.where(length > 0.0, length, 1.0)
    return apart
