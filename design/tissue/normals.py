"""Estimate outward normals of a point cloud (Hoppe et al. 1992, doi 10.1145/133994.134011)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from kernels.arrays import FloatArray

_LEAST_WEIGHT = 1e-3
"""Added to each edge's weight: a weight of 0 would be no edge."""


def estimate_normals(points: FloatArray, neighbours: NDArray[np.int64]) -> tuple[FloatArray, int]:
    """Normals from the neighbours' least extent, made to agree along a least spanning tree.

    Edges weigh 1 - |cosine| between their ends' normals, and more the more they run along them,
    so that orientation is handed on where the surface is flat and within one sheet. Each separate
    part begins at its highest point, whose normal looks up.

    Parameters
    ----------
    points : (n, 3) float64
    neighbours : (n, k) int64
        Nearest points of each, itself left out.

    Returns
    -------
    normals : (n, 3) float64
    parts : int
        Separate parts of the neighbours' graph.
    """
    around = points[neighbours] - points[neighbours].mean(axis=1, keepdims=True)
    covariance = np.einsum("nki,nkj->nij", around, around)
    normals: FloatArray = np.linalg.eigh(covariance)[1][:, :, 0]
    one = np.repeat(np.arange(len(points)), neighbours.shape[1])
    two = neighbours.ravel()
    cosine = np.minimum(np.abs(np.einsum("ij,ij->i", normals[one], normals[two])), 1.0)
    way = points[two] - points[one]
    way /= np.linalg.norm(way, axis=1)[:, None]
    # A step along the normals leads to another sheet: across a narrow gap, or through a wall.
    across = sum(np.einsum("ij,ij->i", normals[end], way) ** 2 for end in (one, two))
    cost = 1.0 - cosine + across + _LEAST_WEIGHT
    low, high = np.minimum(one, two), np.maximum(one, two)
    _, kept = np.unique(low * len(points) + high, return_index=True)
    shape = (len(points), len(points))
    tree = minimum_spanning_tree(
        coo_matrix((cost[kept], (low[kept], high[kept])), shape=shape).tocsr()
    )
    parts, part = connected_components(tree, directed=False)
    for number in range(parts):
        members = np.flatnonzero(part == number)
        top = int(members[np.argmax(points[members, 2])])
        _hand_on(normals, tree, top)
    return normals, int(parts)


def _hand_on(normals: FloatArray, tree: object, top: int) -> None:
    """Turn normals to agree with the one before them on the way from ``top``, in place."""
    if normals[top, 2] < 0:
        normals[top] *= -1.0
    order, before = breadth_first_order(tree, top, directed=False)
    # Signs multiply along the way, so a loop over the points in order is enough.
    for here in order[1:]:
        if normals[here] @ normals[before[here]] < 0:
            normals[here] *= -1.0
