"""Curvature at each triangle of a closed mesh, and sample points along its sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray

SHARP_RAD = 0.6
"""Edges that bend by more are edges, not facets of something round."""
RIM_STEP_MM = 0.05
"""Sharp edges are sampled so finely."""


@dataclass(frozen=True)
class Edges:
    """Where the triangles of a closed mesh meet.

    Attributes
    ----------
    one, other : (e,) int64
        The two triangles of each edge.
    tail, way : (e, 3) float64, mm
        An edge runs from `tail` to ``tail + way``.
    angle : (e,) float64, rad
        By which the surface bends there, above 0 where it bulges.
    """

    one: IntArray
    other: IntArray
    tail: FloatArray
    way: FloatArray
    angle: FloatArray

    @staticmethod
    def of(faces: IntArray, triangles: FloatArray) -> Edges:
        """Of ``faces`` (m, 3), vertices of a closed mesh, and their corners (m, 3, 3), mm."""
        tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        low, high = np.minimum(tail, head), np.maximum(tail, head)
        order = np.lexsort((high, low))
        low, high = low[order], high[order]
        pair = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
        first, second = order[pair], order[pair + 1] // 3
        start = triangles.reshape(-1, 3)[first]
        way = np.roll(triangles, -1, axis=1).reshape(-1, 3)[first] - start
        return Edges(first // 3, second, start, way, _bend(triangles, first // 3, second, way))

    @property
    def sharp(self) -> NDArray[np.bool_]:
        """Edges that are edges of the part, not seams between facets of something round."""
        return np.abs(self.angle) >= SHARP_RAD


def face_curvature(triangles: FloatArray, edges: Edges) -> FloatArray:
    """Sum of the principal curvatures of each triangle, (m,), 1/mm, above 0 where it bulges.

    An edge of length l that bends by θ carries θ l of it, half to either side (Cohen-Steiner &
    Morvan 2003, 10.1145/777792.777839); what slivers get of that is evened out over their
    neighbours. Sharp edges carry none, and nothing is evened out over them.
    """
    size = np.linalg.norm(_twice_area(triangles), axis=1)
    smooth = ~edges.sharp
    one, other = edges.one[smooth], edges.other[smooth]
    share = 0.5 * edges.angle[smooth] * np.linalg.norm(edges.way[smooth], axis=1)
    count = len(triangles)
    bent = np.asarray(np.bincount(one, share, count) + np.bincount(other, share, count), float)
    return np.asarray(_evened(bent, one, other) / _evened(0.5 * size, one, other))


def rim_samples(edges: Edges) -> FloatArray:
    """Points on the sharp edges, (r, 3), mm, no further apart than `RIM_STEP_MM`."""
    tail, way = edges.tail[edges.sharp], edges.way[edges.sharp]
    steps = np.ceil(np.linalg.norm(way, axis=1) / RIM_STEP_MM).astype(np.int64)
    first = np.cumsum(steps) - steps
    which = np.repeat(np.arange(len(way)), steps)
    share = (np.arange(len(which)) - first[which] + 0.5) / steps[which]
    return np.asarray(tail[which] + share[:, None] * way[which])


def _twice_area(triangles: FloatArray) -> FloatArray:
    """Normals as long as twice the area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _bend(triangles: FloatArray, one: IntArray, other: IntArray, way: FloatArray) -> FloatArray:
    """Angle of each edge, above 0 where the surface bulges."""
    normal = _twice_area(triangles)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    sine = (np.cross(normal[one], normal[other]) * way).sum(axis=1)
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-30)
    return np.arctan2(sine / length, (normal[one] * normal[other]).sum(axis=1))


def _evened(values: FloatArray, one: IntArray, other: IntArray) -> FloatArray:
    """Each triangle's value and those of its neighbours."""
    count = len(values)
    return np.asarray(
        values + np.bincount(one, values[other], count) + np.bincount(other, values[one], count)
    )
