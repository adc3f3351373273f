"""Find the nearest point of a triangle surface to each given point."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.bvh import TriangleTree, nearest_triangle
from kernels import jit, pjit
from kernels.arrays import FloatArray


class NearestPoints(NamedTuple):
    """Nearest points on a surface.

    Attributes
    ----------
    face : (n,) int64
        Triangle of the mesh.
    weight : (n, 3) float64
        Of its corners; they add up to 1.
    """

    face: NDArray[np.int64]
    weight: FloatArray


def nearest_feet(tree: TriangleTree, points: FloatArray) -> NearestPoints:
    """The nearest place of the surface to each of ``points`` (n, 3), mm."""
    face, weight = np.empty(len(points), np.int64), np.empty((len(points), 3))
    _feet(tree, np.ascontiguousarray(points, dtype=np.float64), face, weight)
    return NearestPoints(face, weight)


@jit
def _on_edge(p: Any, a: Any, b: Any) -> float:
    """Share of the way from a to b of the place nearest to p."""
    along = b - a
    square = np.dot(along, along)
    return min(max(np.dot(p - a, along) / square, 0.0), 1.0) if square > 0.0 else 0.0


@jit
def _weights(p: Any, tri: Any, weight: Any) -> None:
    """Corners' weights of the place in a triangle that is nearest to p.

    The foot in the triangle's plane, and where that lies outside, the nearest of its edges'.
    """
    corner = tri.reshape(3, 3)
    u, v, w = corner[1] - corner[0], corner[2] - corner[0], p - corner[0]
    uu, uv, vv = np.dot(u, u), np.dot(u, v), np.dot(v, v)
    area = uu * vv - uv * uv
    if area > 1e-14 * uu * vv:
        wu, wv = np.dot(w, u), np.dot(w, v)
        s, t = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            weight[0], weight[1], weight[2] = 1.0 - s - t, s, t
            return
    best = np.inf
    for i in range(3):
        j = (i + 1) % 3
        share = _on_edge(p, corner[i], corner[j])
        off = p - (1.0 - share) * corner[i] - share * corner[j]
        away = np.dot(off, off)
        if away < best:
            best = away
            weight[:] = 0.0
            weight[i], weight[j] = 1.0 - share, share


@pjit
def _feet(tree: Any, points: Any, face: Any, weight: Any) -> None:
    for n in prange(len(points)):
        k = max(0, nearest_triangle(tree, points[n, 0], points[n, 1], points[n, 2], np.inf)[1])
        face[n] = tree.face[k]
        _weights(points[n], tree.triangles[k], weight[n])
