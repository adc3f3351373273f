"""How a triangle mesh bends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SHARP_RAD = 0.6
"""Edges that bend by more are edges, not facets of something round."""


def face_curvature(faces: IntArray, triangles: FloatArray) -> FloatArray:
    """Sum of the principal curvatures of each triangle, (m,), 1/mm, above 0 where it bulges.

    An edge of length l that bends by θ carries θ l of it, half to either side (Cohen-Steiner &
    Morvan 2003, 10.1145/777792.777839); what slivers get of that is evened out over their
    neighbours. Sharp edges carry none, and nothing is evened out over them.

    Parameters
    ----------
    faces : (m, 3)
        Vertices of a closed mesh.
    triangles : (m, 3, 3), mm
        Their corners.
    """
    twice = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(twice, axis=1)
    one, other, way = _edges(faces, triangles)
    angle, length = _bends(twice / size[:, None], one, other, way)
    smooth = np.abs(angle) < SHARP_RAD
    one, other, share = one[smooth], other[smooth], 0.5 * (angle * length)[smooth]
    count = len(faces)
    bent = np.asarray(np.bincount(one, share, count) + np.bincount(other, share, count), float)
    return np.asarray(_evened(bent, one, other) / _evened(0.5 * size, one, other))


def _edges(faces: IntArray, triangles: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """The two triangles of each edge, and its way (e, 3) in the first of them."""
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = np.lexsort((high, low))
    low, high = low[order], high[order]
    pair = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
    way = (np.roll(triangles, -1, axis=1) - triangles).reshape(-1, 3)[order[pair]]
    return order[pair] // 3, order[pair + 1] // 3, way


def _bends(
    normal: FloatArray, one: IntArray, other: IntArray, way: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angle of each edge, above 0 where the surface bulges, and its length."""
    length = np.linalg.norm(way, axis=1)
    sine = (np.cross(normal[one], normal[other]) * way).sum(axis=1) / np.maximum(length, 1e-30)
    return np.arctan2(sine, (normal[one] * normal[other]).sum(axis=1)), length


def _evened(values: FloatArray, one: IntArray, other: IntArray) -> FloatArray:
    """Each triangle's value and those of its neighbours."""
    count = len(values)
    return np.asarray(
        values + np.bincount(one, values[other], count) + np.bincount(other, values[one], count)
    )
