"""Distances of segments and points from a triangle surface."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.bvh import DEPTH, TriangleTree, nearest_triangle
from design.geometry.segments import SLIVER, point_triangle_squared, segment_segment
from kernels import jit, pjit, scalar_jit
from kernels.arrays import FloatArray


@scalar_jit
def pierces(ax: float, ay: float, az: float, bx: float, by: float, bz: float, tri: Any) -> bool:
    """Whether segment ab passes through the triangle ``tri`` (9,), its rim not counted.

    Signed volumes (Ericson, Real-Time Collision Detection, 5.3.4, of the segment's line and
    both ends). A segment in the triangle's plane doesn't pierce it; it is near an edge or an end
    of it is in the triangle, which the distances to these decide, as for a triangle
    without an area.
    """
    ux, uy, uz = tri[3] - tri[0], tri[4] - tri[1], tri[5] - tri[2]
    vx, vy, vz = tri[6] - tri[0], tri[7] - tri[1], tri[8] - tri[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    wx, wy, wz = ax - tri[0], ay - tri[1], az - tri[2]
    above = wx * nx + wy * ny + wz * nz
    below = (bx - tri[0]) * nx + (by - tri[1]) * ny + (bz - tri[2]) * nz
    if above * below > 0.0 or above == below:
        return False
    t = above / (above - below)
    px, py, pz = wx + t * (bx - ax), wy + t * (by - ay), wz + t * (bz - az)
    uu, uv, vv = (
        ux * ux + uy * uy + uz * uz,
        ux * vx + uy * vy + uz * vz,
        vx * vx + vy * vy + vz * vz,
    )
    pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
    if nx * nx + ny * ny + nz * nz <= SLIVER * uu * vv:
        return False
    area2 = uu * vv - uv * uv
    s, r = vv * pu - uv * pv, uu * pv - uv * pu
    return bool(s >= 0.0 and r >= 0.0 and s + r <= area2)


@scalar_jit
def segment_triangle(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, tri: Any
) -> float:
    """Distance of segment ab from the triangle ``tri`` (9,), 0 where it passes through.

    It is reached at an end of the segment or at an edge of the triangle, or is 0.
    """
    if pierces(ax, ay, az, bx, by, bz, tri):
        return 0.0
    best = sqrt(
        min(point_triangle_squared(ax, ay, az, tri), point_triangle_squared(bx, by, bz, tri))
    )
    for edge in range(3):
        i, j = 3 * edge, 3 * ((edge + 1) % 3)
        d, _, _ = segment_segment(
            ax, ay, az, bx, by, bz, tri[i], tri[i + 1], tri[i + 2], tri[j], tri[j + 1], tri[j + 2]
        )
        best = min(best, d)
    return best


@jit
def segment_distance(
    tree: Any,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    bound: float,
) -> float:
    """Distance of segment ab from a `TriangleTree`'s surface, mm; ``bound`` when none is nearer.

    0 where the segment passes through the surface.
    """
    best = bound
    x, y, z = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
    ex, ey, ez = 0.5 * abs(bx - ax), 0.5 * abs(by - ay), 0.5 * abs(bz - az)
    half = sqrt(ex * ex + ey * ey + ez * ez)
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    while top > 0 and best > 0.0:
        top -= 1
        node = stack[top]
        if _apart(tree, node, x, y, z, ex, ey, ez) >= best * best:
            continue
        other = tree.right[node]
        if other >= 0:
            stack[top] = other
            stack[top + 1] = node + 1
            top += 2
            continue
        for k in range(tree.first[node], tree.first[node] + tree.size[node]):
            dx, dy, dz = tree.centre[k, 0] - x, tree.centre[k, 1] - y, tree.centre[k, 2] - z
            # No corner is farther from the centre than its reach.
            far = best + half + tree.reach[k]
            if dx * dx + dy * dy + dz * dz < far * far:
                d = segment_triangle(ax, ay, az, bx, by, bz, tree.triangles[k])
                best = min(best, d)
    return best


@scalar_jit
def _apart(
    tree: Any, node: int, x: float, y: float, z: float, ex: float, ey: float, ez: float
) -> float:
    """Squared distance between a node's box and the box about (x, y, z) of half sides e."""
    low, high = tree.low[node], tree.high[node]
    dx = max(0.0, max(low[0] - x, x - high[0]) - ex)
    dy = max(0.0, max(low[1] - y, y - high[1]) - ey)
    dz = max(0.0, max(low[2] - z, z - high[2]) - ez)
    return dx * dx + dy * dy + dz * dz


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
