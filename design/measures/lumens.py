"""Compute the distance of points to the nearest lumen wall, with a bounding-box tree of vessels."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray

LEAF = 4
"""Pieces in a leaf at most."""

_DEPTH = 64
_BITS = 16


class Lumens(NamedTuple):
    """Pieces along a Z-order curve, and a complete binary tree of boxes over them.

    Node 1 is the top, 2 i and 2 i + 1 the children of i; the second half of the nodes are the
    leaves, of which number j holds pieces ``first[j]`` to ``first[j + 1]``.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    start_radius, end_radius : (n,) float64, mm
    low, high : (2 p, 3) float64, mm
        Boxes of the lumens.
    first : (p + 1,) int64
    """

    start: FloatArray
    end: FloatArray
    start_radius: FloatArray
    end_radius: FloatArray
    low: FloatArray
    high: FloatArray
    first: IntArray


def build_lumens(
    start: FloatArray, end: FloatArray, start_radius: FloatArray, end_radius: FloatArray
) -> Lumens:
    """Sort pieces (n, 3), mm, with radii at both ends (n,), mm, into a tree; n is above 0."""
    order = np.argsort(z_order(0.5 * (start + end)), kind="stable")
    leaves = 1
    while leaves * LEAF < len(order):
        leaves *= 2
    first = np.arange(leaves + 1) * len(order) // leaves
    sides = (start[order], end[order], start_radius[order], end_radius[order])
    low, high = _boxes(*sides, first)
    return Lumens(*sides, low, high, first)


def z_order(points: FloatArray) -> NDArray[np.int64]:
    """Place of each of ``points`` (n, 3) on a Z-order curve of 65,536 cells a side."""
    low = points.min(axis=0)
    extent = max(float((points.max(axis=0) - low).max()), 1e-300)
    cell = ((points - low) * ((2**_BITS - 1) / extent)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


@jit
def _boxes(start: Any, end: Any, start_radius: Any, end_radius: Any, first: Any) -> Any:
    leaves = len(first) - 1
    low = np.full((2 * leaves, 3), np.inf)
    high = np.full((2 * leaves, 3), -np.inf)
    for leaf in range(leaves):
        node = leaves + leaf
        for i in range(first[leaf], first[leaf + 1]):
            ra, rb = start_radius[i], end_radius[i]
            for axis in range(3):
                a, b = start[i, axis], end[i, axis]
                low[node, axis] = min(low[node, axis], min(a - ra, b - rb))
                high[node, axis] = max(high[node, axis], max(a + ra, b + rb))
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            low[node, axis] = min(low[2 * node, axis], low[2 * node + 1, axis])
            high[node, axis] = max(high[2 * node, axis], high[2 * node + 1, axis])
    return low, high


@jit
def wall_distance(lumens: Any, i: int, x: float, y: float, z: float) -> tuple[float, float]:
    """Distance of a point from the wall of piece ``i``, and the lumen's radius there, mm.

    The lumen is the union of spheres along the axis whose radius goes linearly from one end to
    the other; inside it the distance is negative. With ξ along the axis, η from it and slope
    s = (r₁ - r₀)/ℓ the nearest sphere is at ξ + η s / √(1 - s²), held within the piece: the
    distance from a sphere's surface is convex in its place.
    """
    ax, ay, az = lumens.start[i]
    ra, rb = lumens.start_radius[i], lumens.end_radius[i]
    ux, uy, uz = lumens.end[i, 0] - ax, lumens.end[i, 1] - ay, lumens.end[i, 2] - az
    px, py, pz = x - ax, y - ay, z - az
    length = sqrt(ux * ux + uy * uy + uz * uz)
    if length <= 0.0:
        r = max(ra, rb)
        return sqrt(px * px + py * py + pz * pz) - r, r
    along = (px * ux + py * uy + pz * uz) / length
    cx, cy, cz = py * uz - pz * uy, pz * ux - px * uz, px * uy - py * ux
    across = sqrt(cx * cx + cy * cy + cz * cz) / length
    slope = (rb - ra) / length
    at = length if slope > 0.0 else 0.0
    if abs(slope) < 1.0:
        at = along + across * slope / sqrt(1.0 - slope * slope)
        at = min(length, max(0.0, at))
    r = ra + slope * at
    return sqrt((along - at) ** 2 + across * across) - r, r


@jit
def _beyond_box(lumens: Any, node: int, x: float, y: float, z: float) -> float:
    """No wall in the box is nearer than this; within it nothing is known."""
    dx = max(0.0, max(lumens.low[node, 0] - x, x - lumens.high[node, 0]))
    dy = max(0.0, max(lumens.low[node, 1] - y, y - lumens.high[node, 1]))
    dz = max(0.0, max(lumens.low[node, 2] - z, z - lumens.high[node, 2]))
    away = dx * dx + dy * dy + dz * dz
    return sqrt(away) if away > 0.0 else -np.inf


@jit
def _nearest(lumens: Any, x: float, y: float, z: float) -> tuple[float, float]:
    leaves = len(lumens.first) - 1
    best, radius = np.inf, 0.0
    stack = np.empty(_DEPTH, np.int64)
    bound = np.empty(_DEPTH)
    stack[0], bound[0] = 1, -np.inf
    top = 1
    while top > 0:
        top -= 1
        if bound[top] >= best:
            continue
        node = stack[top]
        if node >= leaves:
            for i in range(lumens.first[node - leaves], lumens.first[node - leaves + 1]):
                away, r = wall_distance(lumens, i, x, y, z)
                if away < best:
                    best, radius = away, r
            continue
        near, far = 2 * node, 2 * node + 1
        to_near, to_far = _beyond_box(lumens, near, x, y, z), _beyond_box(lumens, far, x, y, z)
        if to_far < to_near:
            near, far, to_near, to_far = far, near, to_far, to_near
        stack[top], bound[top] = far, to_far
        stack[top + 1], bound[top + 1] = near, to_near
        top += 2
    return best, radius


@pjit
def nearest_walls(lumens: Any, points: Any) -> Any:
    """Distance of each of ``points`` (n, 3) from the nearest wall, and the radius there, mm.

    Negative within a lumen. Neighbours in ``points`` that are neighbours in space find the tree
    in the cache.
    """
    distance = np.empty(len(points))
    radius = np.empty(len(points))
    for i in prange(len(points)):
        distance[i], radius[i] = _nearest(lumens, points[i, 0], points[i, 1], points[i, 2])
    return distance, radius
