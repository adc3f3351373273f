"""Exact distances between points, segments and triangles.

Each takes all cases in turn instead of telling them apart: slower, and hard to get wrong.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.checkers.compiled import compiled


@compiled
def dot(a: Any, b: Any) -> Any:
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Any, b: Any) -> Any:
    """Vector product, a tuple of three."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def less(a: Any, b: Any) -> Any:
    """``a - b``, a tuple of three."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def point_segment(p: Any, a: Any, b: Any) -> Any:
    """Distance from point ``p`` to the segment from ``a`` to ``b``."""
    along, to = less(b, a), less(p, a)
    square = dot(along, along)
    t = min(1.0, max(0.0, dot(to, along) / square)) if square > 0.0 else 0.0
    x = to[0] - t * along[0]
    y = to[1] - t * along[1]
    z = to[2] - t * along[2]
    return np.sqrt(x * x + y * y + z * z)


@compiled
def segment_segment(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Distance between the segments ``a``-``b`` and ``c``-``d``.

    The least of the four ends' distances and, where the common normal of both lines stands within
    both segments, its length.
    """
    least = min(point_segment(a, c, d), point_segment(b, c, d))
    least = min(least, point_segment(c, a, b), point_segment(d, a, b))
    u, v, w = less(b, a), less(d, c), less(c, a)
    normal = cross(u, v)
    square = dot(normal, normal)
    if square > 1e-24 * dot(u, u) * dot(v, v):
        s = dot(cross(w, v), normal) / square
        t = dot(cross(w, u), normal) / square
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            least = min(least, abs(dot(w, normal)) / np.sqrt(square))
    return least


@compiled
def over_triangle(p: Any, one: Any, two: Any, three: Any) -> Any:
    """Whether the foot of the perpendicular from ``p`` to the triangle's plane lies within it."""
    normal = cross(less(two, one), less(three, one))
    side1 = dot(cross(less(two, one), less(p, one)), normal)
    side2 = dot(cross(less(three, two), less(p, two)), normal)
    side3 = dot(cross(less(one, three), less(p, three)), normal)
    return side1 >= 0.0 and side2 >= 0.0 and side3 >= 0.0


@compiled
def segment_triangle(a: Any, b: Any, one: Any, two: Any, three: Any) -> Any:
    """Distance between the segment ``a``-``b`` and a triangle; 0 where it pierces it."""
    least = min(segment_segment(a, b, one, two), segment_segment(a, b, two, three))
    least = min(least, segment_segment(a, b, three, one))
    normal = cross(less(two, one), less(three, one))
    size = np.sqrt(dot(normal, normal))
    if size == 0.0:
        return least
    above_a, above_b = dot(less(a, one), normal) / size, dot(less(b, one), normal) / size
    if over_triangle(a, one, two, three):
        least = min(least, abs(above_a))
    if over_triangle(b, one, two, three):
        least = min(least, abs(above_b))
    if above_a * above_b <= 0.0 and above_a != above_b:
        t = above_a / (above_a - above_b)
        at = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]))
        if over_triangle(at, one, two, three):
            least = 0.0
    return least
