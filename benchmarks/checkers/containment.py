"""Find pieces whose lumen isn't wholly in the tissue, against its exact surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.meshes import (
    BoxTree,
    box_tree,
    cross,
    dot,
    first_in,
    less,
    meets,
    segment_triangle,
)
from benchmarks.checkers.networks import Pieces

ROUNDING_MM = 1e-9

# Three directions that no drawn edge or face is likely to lie along.
_RAYS = np.array([[0.577, 0.612, 0.540], [-0.802, 0.267, 0.535], [0.169, -0.921, 0.350]])


@dataclass(frozen=True)
class Outside:
    """Pieces that aren't wholly in the tissue, less those that leave an inlet.

    ``excess_mm``: how far the lumen reaches beyond the surface: radius less the axis's distance to
    it, or infinity where the axis is outside or passes the surface.
    """

    pieces: NDArray[np.int64]
    excess_mm: NDArray[np.float64]


def pieces_outside(net: Pieces, triangles: NDArray[np.float64]) -> Outside:
    """Find the pieces whose lumen (a capsule) leaves the tissue, triangles (f, 3, 3), mm.

    A piece is inside when no point of its axis is nearer to the surface than its (larger) radius,
    and its end has a winding number above 0 with respect to the closed surface, wound outward.
    """
    tree = surface_tree(triangles)
    radius = net.widest
    distance = to_surface(net.start, net.end, radius, tree, triangles[tree.order])
    excess = np.where(distance < radius - ROUNDING_MM, radius - distance, 0.0)
    excess[(distance == 0) | (winding_numbers(net.end, triangles, tree) <= 0)] = np.inf
    excess[np.isin(net.node[:, 0], net.inlets())] = 0.0
    pieces = np.flatnonzero(excess > 0)
    return Outside(pieces, excess[pieces])


def surface_tree(triangles: NDArray[np.float64]) -> BoxTree:
    """The box tree of a surface (f, 3, 3)."""
    return box_tree(triangles.min(axis=1), triangles.max(axis=1))


def winding_numbers(
    points: NDArray[np.float64], triangles: NDArray[np.float64], tree: BoxTree | None = None
) -> NDArray[np.int64]:
    """How often the surface winds around each point, (n,).

    Signed crossings of a ray; two of three directions must agree, since a ray may meet an edge.
    """
    tree = tree or surface_tree(triangles)
    found: NDArray[np.int64] = _windings(points, _RAYS, tree, triangles[tree.order])
    return found


@compiled
def to_surface(start: Any, end: Any, within: Any, tree: Any, triangles: Any) -> Any:
    """Distance from each axis to the surface where it is below ``within``, else ``within``."""
    n = len(triangles)
    stack, levels_of = np.empty(128, np.int64), np.empty(128, np.int64)
    result = within.copy()
    low, high = np.empty(3), np.empty(3)
    for i in range(len(start)):
        for axis in range(3):
            low[axis] = min(start[i, axis], end[i, axis]) - within[i]
            high[axis] = max(start[i, axis], end[i, axis]) + within[i]
        stack[0], levels_of[0], depth = 1, 0, 1
        while depth > 0:
            depth -= 1
            k, level = stack[depth], levels_of[depth]
            if not meets(tree.around, k, low, high):
                continue
            if level < tree.levels:
                stack[depth], levels_of[depth] = 2 * k, level + 1
                stack[depth + 1], levels_of[depth + 1] = 2 * k + 1, level + 1
                depth += 2
                continue
            for f in range(first_in(k, level, n), first_in(k + 1, level, n)):
                one, two, three = triangles[f, 0], triangles[f, 1], triangles[f, 2]
                result[i] = min(result[i], segment_triangle(start[i], end[i], one, two, three))
    return result


@compiled
def _windings(points: Any, rays: Any, tree: Any, triangles: Any) -> Any:
    result = np.empty(len(points), np.int64)
    for i in range(len(points)):
        one = _crossings(points[i], rays[0], tree, triangles)
        two = _crossings(points[i], rays[1], tree, triangles)
        result[i] = one if one == two else _crossings(points[i], rays[2], tree, triangles)
    return result


@compiled
def _crossings(p: Any, ray: Any, tree: Any, triangles: Any) -> int:
    """Faces left less faces entered along a ray from ``p``."""
    n = len(triangles)
    stack, levels_of = np.empty(128, np.int64), np.empty(128, np.int64)
    stack[0], levels_of[0], depth, total = 1, 0, 1, 0
    while depth > 0:
        depth -= 1
        k, level = stack[depth], levels_of[depth]
        if not _ray_meets(tree.around, k, p, ray):
            continue
        if level < tree.levels:
            stack[depth], levels_of[depth] = 2 * k, level + 1
            stack[depth + 1], levels_of[depth + 1] = 2 * k + 1, level + 1
            depth += 2
            continue
        for f in range(first_in(k, level, n), first_in(k + 1, level, n)):
            total += _passes(p, ray, triangles[f, 0], triangles[f, 1], triangles[f, 2])
    return total


@compiled
def _ray_meets(around: Any, node: int, p: Any, ray: Any) -> bool:
    near, far = 0.0, np.inf
    for axis in range(3):
        one = (around[node, axis] - p[axis]) / ray[axis]
        two = (around[node, axis + 3] - p[axis]) / ray[axis]
        near, far = max(near, min(one, two)), min(far, max(one, two))
    return near <= far


@compiled
def _passes(p: Any, ray: Any, one: Any, two: Any, three: Any) -> int:
    """1 where the ray leaves through the triangle, -1 where it enters, else 0.

    The ray passes when it sees the three edges turn the same way (signed volumes).
    """
    a, b, c = less(one, p), less(two, p), less(three, p)
    turn1, turn2, turn3 = dot(cross(a, b), ray), dot(cross(b, c), ray), dot(cross(c, a), ray)
    ahead = dot(a, cross(less(two, one), less(three, one)))
    if turn1 > 0.0 and turn2 > 0.0 and turn3 > 0.0 and ahead > 0.0:
        return 1
    if turn1 < 0.0 and turn2 < 0.0 and turn3 < 0.0 and ahead < 0.0:
        return -1
    return 0
