"""Bounding-volume tree over triangles: exact nearest distance, and triangles within a radius."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.triangles import point_triangle_squared
from kernels import jit, pjit

FloatArray = NDArray[np.float64]

LEAF = 4
"""Triangles in a leaf: a cache line or two each, cheaper to test than to part further."""

DEPTH = 64
"""Places on the stack of a walk; median splits of 2**31 triangles need 31."""


class TriangleTree(NamedTuple):
    """Triangles in the order of the tree's leaves, and its boxes.

    Attributes
    ----------
    triangles : (f, 9) float64, mm
        Corner coordinates, sorted by leaf.
    face : (f,) int32
        Number of each in the mesh.
    centre : (f, 3) float64, mm
        Centroid of each.
    reach : (f,) float64, mm
        Of the farthest corner from the centroid.
    low, high : (m, 3) float64, mm
        Boxes; node 0 is the top.
    right : (m,) int32
        Second child of a node (the first follows it); -1 at a leaf.
    first, size : (m,) int32
        Triangles of a leaf.
    """

    triangles: FloatArray
    face: NDArray[np.int32]
    centre: FloatArray
    reach: FloatArray
    low: FloatArray
    high: FloatArray
    right: NDArray[np.int32]
    first: NDArray[np.int32]
    size: NDArray[np.int32]


def build_triangle_tree(vertices: FloatArray, faces: NDArray[np.int32]) -> TriangleTree:
    """Build the tree over ``faces`` (f, 3) of ``vertices`` (n, 3), mm, by median splits."""
    corners = np.ascontiguousarray(vertices[faces].reshape(len(faces), 9))
    centre = corners.reshape(-1, 3, 3).mean(axis=1)
    order, right, first, count = _split(centre)
    triangles = np.ascontiguousarray(corners[order])
    low, high = _boxes(triangles, right, first, count)
    centre = np.ascontiguousarray(centre[order])
    reach = np.linalg.norm(triangles.reshape(-1, 3, 3) - centre[:, None], axis=2).max(axis=1)
    face = order.astype(np.int32)
    return TriangleTree(triangles, face, centre, reach, low, high, right, first, count)


@jit
def _split(centre: Any) -> Any:
    size = len(centre)
    order = np.arange(size)
    room = 2 * (2 * size // LEAF + 2)
    right = np.full(room, -1, np.int32)
    first = np.zeros(room, np.int32)
    count = np.zeros(room, np.int32)
    stack = np.zeros((DEPTH, 3), np.int64)
    stack[0, 1] = size
    stack[0, 2] = -1
    top = 1
    nodes = 0
    while top > 0:
        top -= 1
        begin, end, father = stack[top]
        node = nodes
        nodes += 1
        if father >= 0:
            right[father] = node
        if end - begin <= LEAF:
            first[node] = begin
            count[node] = end - begin
            continue
        axis = _longest_axis(centre, order, begin, end)
        part = order[begin:end].copy()
        order[begin:end] = part[np.argsort(centre[part, axis], kind="mergesort")]
        middle = (begin + end) // 2
        stack[top] = (middle, end, node)
        stack[top + 1] = (begin, middle, -1)
        top += 2
    return order, right[:nodes].copy(), first[:nodes].copy(), count[:nodes].copy()


@jit
def _longest_axis(centre: Any, order: Any, begin: int, end: int) -> int:
    low = centre[order[begin]].copy()
    high = low.copy()
    for k in range(begin, end):
        for axis in range(3):
            value = centre[order[k], axis]
            low[axis] = min(low[axis], value)
            high[axis] = max(high[axis], value)
    return int(np.argmax(high - low))


@jit
def _boxes(triangles: Any, right: Any, first: Any, count: Any) -> Any:
    nodes = len(right)
    low = np.full((nodes, 3), np.inf)
    high = np.full((nodes, 3), -np.inf)
    # Children come after their parent, so backwards is from the leaves up.
    for node in range(nodes - 1, -1, -1):
        for axis in range(3):
            if right[node] >= 0:
                low[node, axis] = min(low[node + 1, axis], low[right[node], axis])
                high[node, axis] = max(high[node + 1, axis], high[right[node], axis])
            for k in range(first[node], first[node] + count[node]):
                for corner in range(3):
                    value = triangles[k, 3 * corner + axis]
                    low[node, axis] = min(low[node, axis], value)
                    high[node, axis] = max(high[node, axis], value)
    return low, high


@jit
def box_squared(tree: Any, node: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point from a node's box."""
    dx = max(0.0, max(tree.low[node, 0] - x, x - tree.high[node, 0]))
    dy = max(0.0, max(tree.low[node, 1] - y, y - tree.high[node, 1]))
    dz = max(0.0, max(tree.low[node, 2] - z, z - tree.high[node, 2]))
    return dx * dx + dy * dy + dz * dz


@jit
def nearest_distance(tree: Any, x: float, y: float, z: float, bound: float) -> float:
    """Unsigned distance of a point from the surface, mm; ``bound`` when nothing is nearer."""
    best = bound * bound
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if box_squared(tree, node, x, y, z) >= best:
            continue
        other = tree.right[node]
        if other < 0:
            for k in range(tree.first[node], tree.first[node] + tree.size[node]):
                best = min(best, point_triangle_squared(x, y, z, tree.triangles[k]))
            continue
        near, far = node + 1, other
        if box_squared(tree, far, x, y, z) < box_squared(tree, near, x, y, z):
            near, far = far, near
        stack[top] = far
        stack[top + 1] = near
        top += 2
    return sqrt(best)


@jit
def gather_within(tree: Any, x: float, y: float, z: float, radius: float, found: Any) -> int:
    """Write the triangles within ``radius`` of a point into ``found``; return how many.

    ``found`` must hold as many as the tree has.
    """
    limit = radius * radius
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    size = 0
    while top > 0:
        top -= 1
        node = stack[top]
        if box_squared(tree, node, x, y, z) > limit:
            continue
        other = tree.right[node]
        if other >= 0:
            stack[top] = other
            stack[top + 1] = node + 1
            top += 2
            continue
        for k in range(tree.first[node], tree.first[node] + tree.size[node]):
            if point_triangle_squared(x, y, z, tree.triangles[k]) <= limit:
                found[size] = k
                size += 1
    return size


@pjit
def nearest_distances(tree: Any, points: Any) -> Any:
    """Unsigned distance of each of ``points`` (n, 3) from the surface, (n,), mm."""
    from_surface = np.empty(len(points))
    for i in prange(len(points)):
        from_surface[i] = nearest_distance(tree, points[i, 0], points[i, 1], points[i, 2], np.inf)
    return from_surface
