"""Read a case's mesh, divide it among MPI ranks, label its boundary; define finite elements."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import mesh as meshes

from .world import WORLD

# VTK's order of a tetrahedron's ten nodes to basix's: corners, then edges 23, 13, 12, 03, 02, 01.
TO_BASIX = [0, 1, 2, 3, 9, 8, 5, 7, 6, 4]


def elements() -> tuple[Any, Any]:
    """Quadratic geometry, and Taylor and Hood's pair, in the words of this version of FEniCSx."""
    cell = "tetrahedron"
    try:
        from basix.ufl import element, mixed_element  # from 0.7
    except ImportError:
        curved = ufl.VectorElement("Lagrange", cell, 2)
        return curved, ufl.MixedElement(curved, ufl.FiniteElement("Lagrange", cell, 1))
    curved = element("Lagrange", cell, 2, shape=(3,))
    return curved, mixed_element([curved, element("Lagrange", cell, 1)])


def rows(dofmap: Any) -> Any:
    """A dofmap as an array, a row a cell (it is an adjacency list before 0.7)."""
    if hasattr(dofmap, "array"):
        count = len(dofmap.offsets) - 1
        return np.asarray(dofmap.array).reshape(count, -1)
    return np.asarray(dofmap)


def share(folder: Path, name: str) -> Any:
    """Rows of an array that this rank reads."""
    stored = np.load(folder / name, mmap_mode="r")
    ends = np.linspace(0, len(stored), WORLD.size + 1).astype(np.int64)
    return np.array(stored[ends[WORLD.rank] : ends[WORLD.rank + 1]])


def distributed(folder: Path) -> Any:
    """The case's mesh, divided by PETSc's partitioner."""
    cells = np.ascontiguousarray(share(folder, "tets.npy")[:, TO_BASIX])
    words = inspect.signature(meshes.create_mesh).parameters
    domain = {"domain" if "domain" in words else "e": ufl.Mesh(elements()[0])}
    return meshes.create_mesh(WORLD, cells=cells, x=share(folder, "points.npy"), **domain)


def tagged(domain: Any, folder: Path, node: Any) -> Any:
    """Labels of the boundary's facets, found by the corners that they have in the file."""
    faces, label = np.load(folder / "faces.npy")[:, :3], np.load(folder / "label.npy")
    topology = domain.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    facets = np.sort(np.asarray(meshes.exterior_facet_indices(topology), dtype=np.int32))
    to_cell = topology.connectivity(2, 3)
    cell = to_cell.array[to_cell.offsets[facets]]
    # Facet i of a cell lies across from its corner i.
    across = rows(topology.connectivity(3, 2))[cell] == facets[:, None]
    corners = node[rows(domain.geometry.dofmap)[cell, :4]][~across].reshape(-1, 3)
    both = np.concatenate([np.sort(faces, axis=1), np.sort(corners, axis=1)])
    _, which = np.unique(both, axis=0, return_inverse=True)
    mark = np.full(int(which.max()) + 1, -1, dtype=np.int32)
    mark[which[: len(faces)]] = label
    marks = mark[which[len(faces) :]]
    if (marks < 0).any():
        raise ValueError("a face of the boundary isn't in faces.npy; write the case again")
    return meshes.meshtags(domain, 2, facets, marks)


def node_of(space: Any, domain: Any, node: Any) -> Any:
    """The file's node at each point of a Lagrange space on this rank.

    A space of the geometry's own degree numbers a cell's points as the geometry does, one of
    corners alone takes the first four.
    """
    points = rows(space.dofmap.list)
    nodes = np.full(int(points.max()) + 1, -1, dtype=np.int64)
    nodes[points] = node[rows(domain.geometry.dofmap)[:, : points.shape[1]]]
    return nodes
