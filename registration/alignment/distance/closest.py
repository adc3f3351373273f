"""Kernels: nearest point and signed distance to a triangle surface, by a tree of boxes."""

from __future__ import annotations

import numba
import numpy as np

from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray

UNKNOWN = np.empty(0, dtype=np.int64)
"""Guesses of `nearest` where there are none."""
CHUNK = 64
"""Points a thread takes at a time; each starts from the last one's triangle."""
FACE, EDGE_AB, EDGE_BC, EDGE_CA, CORNER_A, CORNER_B, CORNER_C = range(7)


@jit
def closest_on_triangle(
    px: float, py: float, pz: float, triangles: FloatArray, t: int
) -> tuple[float, float, float, int]:
    """Nearest point of a triangle of (m, 3, 3) and the feature it lies on.

    Voronoi regions after Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    # Numbers are taken one by one: a view of a row would cost more than what is computed of it.
    ax, ay, az = triangles[t, 0, 0], triangles[t, 0, 1], triangles[t, 0, 2]
    bx, by, bz = triangles[t, 1, 0] - ax, triangles[t, 1, 1] - ay, triangles[t, 1, 2] - az
    cx, cy, cz = triangles[t, 2, 0] - ax, triangles[t, 2, 1] - ay, triangles[t, 2, 2] - az
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
def _box_distance2(boxes: FloatArray, node: int, px: float, py: float, pz: float) -> float:
    dx = max(boxes[node, 0] - px, 0.0, px - boxes[node, 3])
    dy = max(boxes[node, 1] - py, 0.0, py - boxes[node, 4])
    dz = max(boxes[node, 2] - pz, 0.0, pz - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@jit
def _nearest_one(
    px: float,
    py: float,
    pz: float,
    triangles: FloatArray,
    boxes: FloatArray,
    nodes: IntArray,
    order: IntArray,
    stack: IntArray,
    away: FloatArray,
    guess: int,
) -> tuple[int, int, float, float, float, float]:
    """Nearest triangle, feature, foot and squared distance.

    A `guess` (the last point's triangle, or -1) bounds the search from its beginning. `stack` and
    `away` are room for nodes that are still to be looked at, and for their squared distances.
    """
    best, fx, fy, fz = np.inf, 0.0, 0.0, 0.0
    feature, triangle = 0, 0
    if guess >= 0:
        fx, fy, fz, feature = closest_on_triangle(px, py, pz, triangles, guess)
        best = (px - fx) ** 2 + (py - fy) ** 2 + (pz - fz) ** 2
        triangle = guess
    stack[0], away[0] = 0, 0.0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if away[top] >= best:
            continue
        left, right = nodes[node, 0], nodes[node, 1]
        if left < 0:
            for k in range(-1 - left, right):
                t = order[k]
                x, y, z, where = closest_on_triangle(px, py, pz, triangles, t)
                d2 = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
                if d2 < best:
                    best, feature, triangle = d2, where, t
                    fx, fy, fz = x, y, z
            continue
        to_left = _box_distance2(boxes, left, px, py, pz)
        to_right = _box_distance2(boxes, right, px, py, pz)
        if to_left < to_right:
            left, right, to_left, to_right = right, left, to_right, to_left
        # The nearer one goes on top; what is farther than the best isn't looked at again.
        if to_left < best:
            stack[top], away[top] = left, to_left
            top += 1
        if to_right < best:
            stack[top], away[top] = right, to_right
            top += 1
    return triangle, feature, fx, fy, fz, best


@pjit
def nearest(
    points: FloatArray,
    triangles: FloatArray,
    boxes: FloatArray,
    nodes: IntArray,
    order: IntArray,
    normals: FloatArray,
    guesses: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Signed distance, nearest point, direction of growing distance and triangle of each point.

    ``normals`` (m, 7, 3) holds the pseudonormal of each triangle's face, edges and corners
    (Bærentzen & Aanæs 2005, 10.1109/TVCG.2005.49), whose side is the true side even where the
    nearest point lies on an edge. Positive is outside. ``guesses`` (n,) are triangles near each
    point, or empty: the nearer the triangle, the less is searched.
    """
    n = len(points)
    distance = np.empty(n)
    foot = np.empty((n, 3))
    direction = np.empty((n, 3))
    face = np.empty(n, dtype=np.int64)
    for chunk in numba.prange((n + CHUNK - 1) // CHUNK):
        stack = np.empty(128, dtype=np.int64)
        away = np.empty(128)
        triangle = -1
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            if len(guesses) > 0:
                triangle = guesses[i]
            triangle, feature, fx, fy, fz, best = _nearest_one(
                px, py, pz, triangles, boxes, nodes, order, stack, away, triangle
            )
            ex, ey, ez = px - fx, py - fy, pz - fz
            nx, ny, nz = (
                normals[triangle, feature, 0],
                normals[triangle, feature, 1],
                normals[triangle, feature, 2],
            )
            side = 1.0 if ex * nx + ey * ny + ez * nz >= 0.0 else -1.0
            length = np.sqrt(best)
            distance[i], face[i] = side * length, triangle
            foot[i, 0], foot[i, 1], foot[i, 2] = fx, fy, fz
            if length > 1e-6:
                nx, ny, nz = side * ex / length, side * ey / length, side * ez / length
            direction[i, 0], direction[i, 1], direction[i, 2] = nx, ny, nz
    return distance, foot, direction, face
