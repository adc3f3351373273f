"""Find a surface's connected shells and their nesting; unite shells that overlap."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold, OpType
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.errors import TissueError
from design.geometry import build_triangle_tree
from design.geometry.surface import Surface
from design.tissue.closed import FaceArray, FloatArray, edges_of, enclosed_volume
from design.tissue.crossing_faces import crossing_faces
from design.tissue.depth import winding_number
from design.tissue.manifolds import manifold_of, surface_of

_VOTES = 15
_MOST = 2000
"""Shells beyond which a mesh is taken for rubbish: all pairs are compared."""


def neighbours(
    faces: FaceArray,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Pairs of faces at edges that have two, and whether they agree on what is outside."""
    edges = edges_of(faces)
    order = np.argsort(edges.of_face, kind="stable")
    first = np.concatenate([[0], np.cumsum(edges.uses)[:-1]])
    pair = edges.uses == 2
    one, two = order[first[pair]] // 3, order[first[pair] + 1] // 3
    return one, two, edges.balance[pair] == 0


def shells_of(faces: FaceArray) -> NDArray[np.int64]:
    """Number of the shell that each face belongs to, (m,); joined across edges with two faces."""
    one, two, _ = neighbours(faces)
    ones = np.ones(len(one), dtype=np.int8)
    graph = coo_matrix((ones, (one, two)), shape=(len(faces), len(faces)))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def enclosures(points: FloatArray, faces: FaceArray, shell: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which shell (first index) holds which (second), (s, s), by most of some vertices.

    Raises
    ------
    TissueError
        When there are more shells than can be compared.
    """
    count = int(shell.max()) + 1
    if count > _MOST:
        raise TissueError(
            f"mesh has {count} separate shells, more than {_MOST}; remove loose parts and try again"
        )
    parts = [faces[shell == n] for n in range(count)]
    corners = [points[part] for part in parts]
    low = np.array([c.min(axis=(0, 1)) for c in corners])
    high = np.array([c.max(axis=(0, 1)) for c in corners])
    holds = np.zeros((count, count), dtype=bool)
    for n in range(count):
        within = (low >= low[n]).all(axis=1) & (high <= high[n]).all(axis=1)
        within[n] = False
        if not within.any():
            continue
        tree = build_triangle_tree(points, parts[n])
        for m in np.flatnonzero(within):
            tried = np.unique(parts[m])
            tried = tried[:: max(1, len(tried) // _VOTES)]
            inside = sum(winding_number(tree, *points[v]) != 0 for v in tried)
            holds[n, m] = 2 * inside > len(tried)
    return holds


def unite_shells(points: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray, int, int]:
    """Unite solids that overlap or lie within one another.

    Each shell that looks inward is a cavity of the smallest one around it.

    Returns
    -------
    points, faces
        Untouched when no two solids overlap.
    united : int
        Shells that took part, 0 for none.
    swallowed : int
        Shells that look outward and lie wholly within solid.
    """
    shell = shells_of(faces)
    count = int(shell.max()) + 1
    if count == 1:
        return points, faces, 0, 0
    volume = np.array([enclosed_volume(points, faces[shell == n]) for n in range(count)])
    holds = enclosures(points, faces, shell)
    # Solids less cavities around each: 0 for one that stands free or within a cavity.
    layers = (holds * np.sign(volume)[:, None]).sum(axis=0)
    swallowed = (volume > 0) & (layers > 0)
    pairs = crossing_faces(points, faces)
    crossed = np.unique(shell[pairs])
    if len(crossed) == 0 and not swallowed.any():
        return points, faces, 0, 0
    whole = Manifold.batch_boolean(_solids(points, faces, shell, volume, holds), OpType.Add)
    found = surface_of(whole, "the union of the mesh's shells")
    united = max(len(crossed), int(swallowed.sum()) + 1)
    return found.vertices, found.faces, united, int(swallowed.sum())


def _solids(
    points: FloatArray,
    faces: FaceArray,
    shell: NDArray[np.int64],
    volume: FloatArray,
    holds: NDArray[np.bool_],
) -> list[Manifold]:
    """One solid per shell that looks outward, less its cavities."""
    members = {int(n): [int(n)] for n in np.flatnonzero(volume > 0)}
    for n in np.flatnonzero(volume <= 0):
        around = np.flatnonzero(holds[:, n] & (volume > 0))
        if len(around):
            members[int(around[np.argmin(volume[around])])].append(int(n))
    return [
        manifold_of(Surface(points, faces[np.isin(shell, group)]), "a shell of the mesh")
        for group in members.values()
    ]
