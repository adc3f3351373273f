"""Graph of neighbouring points below a tissue's surface, along which trunk vessels are laid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.errors import GrowthError
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray

_LINKS = 14
_LONGEST = 2.6
"""Longest edge over the mean distance of neighbours."""


@dataclass(frozen=True)
class Layer:
    """Places that trunks may run through.

    Attributes
    ----------
    points : (n, 3) float64, mm
    first : (n + 1,) int64
        Edges of place ``i`` are ``first[i]:first[i + 1]`` of the arrays below.
    to : (e,) int64
    length : (e,) float64, mm
    """

    points: FloatArray
    first: IntArray
    to: IntArray
    length: FloatArray

    @property
    def spacing_mm(self) -> float:
        """Mean length of the shorter edges, mm."""
        return float(np.percentile(self.length, 25))

    def nearest(self, place: FloatArray) -> int:
        """The place nearest to ``place`` (3,)."""
        return int(np.argmin(np.linalg.norm(self.points - place, axis=1)))


def join_layer(tissue: Tissue, points: FloatArray, least_depth_mm: float) -> Layer:
    """Join places to their neighbours by edges that stay below the surface.

    Only the largest part that hangs together is kept.

    Raises
    ------
    GrowthError
        When fewer than ten places hang together.
    """
    if len(points) < 10:
        raise _too_few(len(points))
    away, near = cKDTree(points).query(points, min(_LINKS + 1, len(points)))
    reach = _LONGEST * float(away[:, 1:4].mean())
    start = np.repeat(np.arange(len(points)), near.shape[1] - 1)
    end, length = near[:, 1:].ravel(), away[:, 1:].ravel()
    kept = (length <= reach) & (length > 0.0)
    start, end, length = start[kept], end[kept], length[kept]
    inside = np.ones(len(start), dtype=np.bool_)
    for part in (0.25, 0.5, 0.75):
        between = points[start] + part * (points[end] - points[start])
        inside &= -tissue.grid.distance(between) >= least_depth_mm
    start, end, length = start[inside], end[inside], length[inside]
    links = coo_matrix((length, (start, end)), shape=(len(points),) * 2).tocsr()
    links = links.maximum(links.T)
    number = connected_components(links, directed=False)[1]
    largest = np.flatnonzero(number == np.argmax(np.bincount(number)))
    if len(largest) < 10:
        raise _too_few(len(largest))
    links = links[largest][:, largest].tocsr()
    links.sort_indices()
    return Layer(
        np.ascontiguousarray(points[largest]),
        links.indptr.astype(np.int64),
        links.indices.astype(np.int64),
        links.data.astype(np.float64),
    )


def below_surface(
    tissue: Tissue, points: FloatArray, inward: FloatArray, depth_mm: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Places ``depth_mm`` below ``points`` (n, 3), and which of them are indeed that deep."""
    below: FloatArray = points + depth_mm * inward
    return below, -tissue.grid.distance(below) >= 0.85 * depth_mm


def _too_few(count: int) -> GrowthError:
    return GrowthError(
        f"the guiding layer has {count} places that hang together; the tissue is too thin there "
        "for these vessels: ask for fewer terminals, a lower depth or a higher pressure drop"
    )
