"""Kernels: the nearest point of a triangle surface, and on which side of it a point lies."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CHUNK = 64
"""Points a thread takes at a time; each starts from the last one's triangle."""
FACE, EDGE_AB, EDGE_BC, EDGE_CA, CORNER_A, CORNER_B, CORNER_C = range(7)


@jit
def closest_on_triangle(
    px: float, py: float, pz: float, tri: FloatArray
) -> tuple[float, float, float, int]:
    """Nearest point of triangle (3, 3) and the feature it lies on.

    Voronoi regions after Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    ax, ay, az = tri[0, 0], tri[0, 1], tri[0, 2]
    bx, by, bz = tri[1, 0] - ax, tri[1, 1] - ay, tri[1, 2] - az
    cx, cy, cz = tri[2, 0] - ax, tri[2, 1] - ay, tri[2, 2] - az
    qx, qy, qz = px - ax, py - ay, pz - az
    d1 = bx * qx + by * qy + bz * qz
    d2 = cx * qx + cy * qy + cz * qz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, CORNER_A
    ux, uy, uz = qx - bx, qy - by, qz - bz
    d3 = bx * ux + by * uy + bz * uz
    d4 = cx * ux + cy * uy + cz * uz
    if d3 >= 0.0 and d4 <= d3:
        return ax + bx, ay + by, az + bz, CORNER_B
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return ax + t * bx, ay + t * by, az + t * bz, EDGE_AB
    ux, uy, uz = qx - cx, qy - cy, qz - cz
    d5 = bx * ux + by * uy + bz * uz
    d6 = cx * ux + cy * uy + cz * uz
    if d6 >= 0.0 and d5 <= d6:
        return ax + cx, ay + cy, az + cz, CORNER_C
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return ax + t * cx, ay + t * cy, az + t * cz, EDGE_CA
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (
            ax + bx + t * (cx - bx),
            ay + by + t * (cy - by),
            az + bz + t * (cz - bz),
            EDGE_BC,
        )
    scale = 1.0 / (va + vb + vc)
    v, w = vb * scale, vc * scale
    return ax + v * bx + w * cx, ay + v * by + w * cy, az + v * bz + w * cz, FACE


@jit
def _box_distance2(box: FloatArray, px: float, py: float, pz: float) -> float:
    dx = max(box[0] - px, 0.0, px - box[3])
    dy = max(box[1] - py, 0.0, py - box[4])
    dz = max(box[2] - pz, 0.0, pz - box[5])
    return dx * dx + dy * dy + dz * dz


@jit
def _nearest_one(
    point: FloatArray,
    triangles: FloatArray,
    boxes: FloatArray,
    nodes: IntArray,
    order: IntArray,
    stack: IntArray,
    guess: int,
    found: FloatArray,
) -> tuple[int, int]:
    """Nearest triangle and feature; foot and squared distance go into `found`.

    A `guess` (the last point's triangle, or -1) bounds the search from its beginning.
    """
    px, py, pz = point
    best = np.inf
    feature, triangle = 0, 0
    if guess >= 0:
        x, y, z, feature = closest_on_triangle(px, py, pz, triangles[guess])
        best = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
        triangle = guess
        found[0], found[1], found[2] = x, y, z
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _box_distance2(boxes[node], px, py, pz) >= best:
            continue
        if nodes[node, 0] < 0:
            for k in range(-1 - nodes[node, 0], nodes[node, 1]):
                t = order[k]
                x, y, z, where = closest_on_triangle(px, py, pz, triangles[t])
                d2 = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
                if d2 < best:
                    best, feature, triangle = d2, where, t
                    found[0], found[1], found[2] = x, y, z
            continue
        left, right = nodes[node]
        if _box_distance2(boxes[left], px, py, pz) < _box_distance2(boxes[right], px, py, pz):
            left, right = right, left
        stack[top], stack[top + 1] = left, right
        top += 2
    found[3] = best
    return triangle, feature


@pjit
def nearest(
    points: FloatArray,
    triangles: FloatArray,
    boxes: FloatArray,
    nodes: IntArray,
    order: IntArray,
    normals: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Signed distance, nearest point, direction of growing distance and triangle of each point.

    ``normals`` (m, 7, 3) holds the pseudonormal of each triangle's face, edges and corners
    (Bærentzen & Aanæs 2005, 10.1109/TVCG.2005.49), whose side is the true side even where the
    nearest point lies on an edge. Positive is outside.
    """
    n = len(points)
    distance = np.empty(n)
    foot = np.empty((n, 3))
    direction = np.empty((n, 3))
    face = np.empty(n, dtype=np.int64)
    for chunk in numba.prange((n + CHUNK - 1) // CHUNK):
        stack = np.empty(128, dtype=np.int64)
        found = np.empty(4)
        triangle = -1
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            triangle, feature = _nearest_one(
                points[i], triangles, boxes, nodes, order, stack, triangle, found
            )
            ex, ey, ez = points[i] - found[:3]
            normal = normals[triangle, feature]
            side = 1.0 if ex * normal[0] + ey * normal[1] + ez * normal[2] >= 0.0 else -1.0
            length = np.sqrt(found[3])
            distance[i] = side * length
            foot[i] = found[:3]
            face[i] = triangle
            if length > 1e-6:
                direction[i, 0] = side * ex / length
                direction[i, 1] = side * ey / length
                direction[i, 2] = side * ez / length
            else:
                direction[i] = normal
    return distance, foot, direction, face
