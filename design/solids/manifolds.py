"""Convert meshes to manifold3d; unite them, or subtract some from a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import Error, Manifold, Mesh64, OpType
from numpy.typing import NDArray

from design.errors import SolidError
from design.solids.solid import Solid
from design.solids.topology import edge_faults
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
