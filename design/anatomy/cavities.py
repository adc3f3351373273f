"""Tell a heart's two cavities apart, and which of them is the left ventricle's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, cKDTree

from design.anatomy.openness import SurfaceSamples
from kernels.arrays import FloatArray, IntArray

_LINKS: Final = 8
_LONGEST: Final = 5.0
"""Longest link of two places over the way between places."""
_THROUGH: Final = 0.5
"""Cosine of a link to the normal into the wall, from which on it leads through the wall."""
_LEAST: Final = 0.1
"""Of all places in cavities, those in the smaller of two."""
_HULL: Final = 1000
"""Places of a cavity by which its convex hull is judged."""
_HOLLOW: Final = 0.015
"""Mean depth of a cavity's places in its convex hull over the hull's size (cube root of volume),
from which on another body bulges into it. The septum makes it 0.028 to 0.071 in the right ventricle
of 38 hearts, of which two are real; the left one has 0.016 at most, 0.023 with an aneurysm."""
_CLEAR: Final = 0.25
"""Difference of the two cavities' depths over their sum, from which on it tells them apart."""


@dataclass(frozen=True)
class Cavities:
    """The two cavities of a heart.

    Attributes
    ----------
    one, two : (k,) int64
        Numbers of the surface samples in each; where ``told``, in the left and the right one.
    told : bool
        Whether their shapes tell which is which: the septum bulges into the right one.
    """

    one: IntArray
    two: IntArray
    told: bool


def find_cavities(samples: SurfaceSamples) -> Cavities | None:
    """The two largest cavities; None where there is one, or none."""
    inner = np.flatnonzero(~samples.outer)
    if len(inner) <= _LINKS:
        return None
    part = _parts(samples.points[inner], samples.inward[inner], way_between(samples.points))
    order = np.argsort(-np.bincount(part), kind="stable")
    if len(order) < 2:
        return None
    one, two = (inner[part == number] for number in order[:2])
    if len(two) < max(_LEAST * len(inner), 2 * _LINKS):
        return None
    hollow_one, hollow_two = _hollowness(samples.points[one]), _hollowness(samples.points[two])
    if hollow_one > hollow_two:
        one, two, hollow_one, hollow_two = two, one, hollow_two, hollow_one
    told = hollow_two > _HOLLOW and hollow_two - hollow_one > _CLEAR * (hollow_one + hollow_two)
    return Cavities(one, two, bool(told))


def way_between(points: FloatArray) -> float:
    """Median way from each place (n, 3) to the nearest other one, mm."""
    return float(np.median(cKDTree(points).query(points, 2)[0][:, 1]))


def _parts(points: FloatArray, inward: FloatArray, between: float) -> NDArray[np.int32]:
    """Number of the part (n,) of each place; links that lead through the wall join none."""
    away, near = cKDTree(points).query(points, _LINKS + 1)
    a, b, length = np.repeat(np.arange(len(points)), _LINKS), near[:, 1:].ravel(), away[:, 1:]
    length = np.maximum(length.ravel(), 1e-12)
    way = (points[b] - points[a]) / length[:, None]
    through = np.einsum("nx,nx->n", way, inward[a]) > _THROUGH
    through |= np.einsum("nx,nx->n", way, inward[b]) < -_THROUGH
    kept = (length < _LONGEST * between) & ~through
    links = coo_matrix((np.ones(kept.sum()), (a[kept], b[kept])), shape=(len(points),) * 2)
    part: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return part


def _hollowness(points: FloatArray) -> float:
    """Mean depth of places (n, 3) in their convex hull, over the cube root of its volume."""
    some = points[:: max(1, len(points) // _HULL)]
    hull = ConvexHull(some)
    depth = -np.max(some @ hull.equations[:, :3].T + hull.equations[:, 3], axis=1)
    return float(depth.mean() / np.cbrt(hull.volume))
