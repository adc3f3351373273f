"""Find a cortex's places from its shape: pial side, thickness, entry of the pial artery."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from design.tissue import Tissue

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEIGHBOURS = 12
_SAME_SIDE = 0.7
"""Cosine between normals of neighbours on one side; rims are sharper."""

_LEAST_SIDE = 0.2
"""Share of the surface that a side has at least."""

_ALIKE = 0.95
"""Share of the larger side from which on two count as equally large."""


@dataclass(frozen=True)
class CortexPlaces:
    """Places of a cortex.

    Attributes
    ----------
    pial : (k,) int64
        Numbers of the surface samples on the pial side.
    outward : (3,) float64
        Mean normal of that side, a unit vector.
    thickness_mm : float
        Median along the normal, or as it is given.
    """

    pial: IntArray
    outward: FloatArray
    thickness_mm: float


def find_cortex_places(
    tissue: Tissue,
    samples: SurfaceSamples,
    direction: FloatArray | None = None,
    thickness_mm: float | None = None,
) -> CortexPlaces:
    """Find the pial side: the larger of the surface's smooth sides, or that of a direction.

    Of two equally large ones (a slab) the one that looks up.

    Parameters
    ----------
    direction : (3,) float64, optional
        Out of the pial side.
    thickness_mm : float, optional
        Of the grey matter, where the shape is thicker.

    Raises
    ------
    TissueError
        When no side is smooth.
    """
    sides = _sides(samples)
    if not sides:
        raise TissueError(
            "no smooth side was found that could be the pial surface; the mesh may be too rough"
        )
    normal = [-samples.inward[side].sum(axis=0) for side in sides]
    if direction is not None:
        best = int(np.argmax([each @ direction for each in normal]))
    else:
        size = np.array([len(side) for side in sides])
        alike = size >= _ALIKE * size.max()
        best = int(np.argmax(np.where(alike, [each[2] for each in normal], -np.inf)))
    pial = sides[best]
    deep = depth_along_normal(tissue, samples.points[pial], samples.inward[pial])
    outward = normal[best]
    return CortexPlaces(
        pial,
        outward / max(float(np.linalg.norm(outward)), 1e-12),
        float(np.median(deep)) if thickness_mm is None else thickness_mm,
    )


def depth_along_normal(tissue: Tissue, points: FloatArray, inward: FloatArray) -> FloatArray:
    """Way (n,) from surface points (n, 3) along ``inward`` (n, 3) to where they leave, mm."""
    least = 0.25 * tissue.grid.spacing_mm
    low, high = tissue.bounds
    far = float(np.linalg.norm(high - low))
    gone = np.full(len(points), 4.0 * least)
    going = np.arange(len(points))
    while len(going):
        room = -tissue.grid.distance(points[going] + gone[going, None] * inward[going])
        on = (room > 0.0) & (gone[going] < far)
        gone[going[on]] += np.maximum(room[on], least)
        going = going[on]
    return gone


def _sides(samples: SurfaceSamples) -> list[IntArray]:
    """Samples of each smooth part of the surface, the largest first."""
    near = cKDTree(samples.points).query(samples.points, _NEIGHBOURS)[1]
    same = np.einsum("nkx,nx->nk", samples.inward[near], samples.inward) > _SAME_SIDE
    begin = np.repeat(np.arange(len(near)), _NEIGHBOURS)[same.ravel()]
    links = coo_matrix((np.ones(len(begin)), (begin, near[same])), shape=(len(near),) * 2)
    number = connected_components(links, directed=False)[1]
    count = np.bincount(number)
    large = [n for n in np.argsort(-count, kind="stable") if count[n] >= _LEAST_SIDE * len(near)]
    return [np.flatnonzero(number == n) for n in large]
