"""Vertices, edges and connected parts of triangle meshes given by their faces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray


class Edges(NamedTuple):
    """The undirected edges of a surface.

    Attributes
    ----------
    ends : (e, 2) int64
        Vertices, the lower number first.
    uses : (e,) int64
        Faces at each.
    balance : (e,) int64
        Faces that pass it upwards less those that pass it downwards; 0 where all agree.
    of_face : (3 m,) int64
        Edge of each face's three sides, face by face.
    """

    ends: NDArray[np.int64]
    uses: NDArray[np.int64]
    balance: NDArray[np.int64]
    of_face: NDArray[np.int64]

    def sides(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sides of faces, edge by edge, (3 m,), and where those of each edge begin, (e,)."""
        first = np.concatenate([[0], np.cumsum(self.uses)[:-1]])
        return np.argsort(self.of_face, kind="stable"), first

    @property
    def open(self) -> int:
        """Edges with an odd number of faces."""
        return int((self.uses % 2 == 1).sum())

    @property
    def turned(self) -> int:
        """Edges whose faces disagree on what is outside."""
        return int(((self.balance != 0) & (self.uses % 2 == 0)).sum())


def edges_of(faces: NDArray[np.integer]) -> Edges:
    """Edges of ``faces`` (m, 3)."""
    one = faces.ravel().astype(np.int64)
    two = faces[:, [1, 2, 0]].ravel().astype(np.int64)
    size = int(faces.max(initial=0)) + 1
    low, high = np.minimum(one, two), np.maximum(one, two)
    keys, of_face, uses = np.unique(low * size + high, return_inverse=True, return_counts=True)
    upward = np.where(one < two, 1, -1)
    balance = np.bincount(of_face, weights=upward, minlength=len(keys)).astype(np.int64)
    ends = np.stack([keys // size, keys % size], axis=1)
    return Edges(ends, uses, balance, of_face)


def connected_parts(links: NDArray[np.integer], count: int) -> IntArray:
    """Return the number of the connected part of each of ``count`` nodes; links (k, 2)."""
    # SciPy takes 0.2 CPU s to load, and merging vertices needs none of it.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    one, two = links.T
    graph = coo_array((np.ones(len(one), np.bool_), (one, two)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def merge_equal(vertices: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distinct places (m, 3), sorted by x, y, z, and which of them each of ``vertices`` (n, 3) has.

    As `numpy.unique` along axis 0, in a quarter of the time and without its copies: a file of a
    million triangles has three million vertices.
    """
    order = np.lexsort(vertices.T[::-1])
    ordered = vertices[order]
    fresh = np.ones(len(ordered), dtype=np.bool_)
    for axis in range(3):
        column = ordered[:, axis]
        fresh[1:] &= column[1:] == column[:-1]
    fresh[1:] = ~fresh[1:]
    index = np.empty(len(ordered), dtype=np.int64)
    index[order] = np.cumsum(fresh) - 1
    return ordered[fresh], index


def without_collapsed(faces: IntArray) -> IntArray:
    """Return the faces (m, 3) whose corners are three different vertices."""
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def merge_vertices(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> tuple[FloatArray, IntArray]:
    """Merge equal vertices (n, 3), drop collapsed faces (m, 3), and vertices without a face."""
    merged, index = merge_equal(np.asarray(vertices, np.float64))
    kept = without_collapsed(index[np.asarray(faces)])
    used, corners = np.unique(kept, return_inverse=True)
    return merged[used], corners.reshape(-1, 3)


MERGE_TRIES = 5
"""Distances of `merge_distances`: the last is 256 times the first, 2 µm at 10 mm."""


def merge_distances(vertices: FloatArray) -> Iterator[float]:
    """Yield distances below which vertices (n, 3) are merged before they are rounded to float32.

    The first is 8 float32 steps at the greatest coordinate (0.008 µm at 10 mm), which nearly always
    keeps a surface closed; each of the others is four times the one before.
    """
    step = 8.0 * float(np.spacing(np.float32(np.abs(vertices).max())))
    for _ in range(MERGE_TRIES):
        yield step
        step *= 4.0
