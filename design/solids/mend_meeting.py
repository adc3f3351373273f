"""Count the faces that a mesh patch under repair intersects, its own included (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry.bvh import DEPTH, boxes_apart, corners_box, next_leaf
from design.geometry.crossings import APART, meeting_kind
from kernels import jit


@jit
def grow(s: Any, count: int) -> None:
    """Let the tree's boxes hold the faces of the patch again."""
    for n in range(count):
        f = s.patch[n]
        if s.dead[f]:
            continue
        s.changed[f] = True
        node = s.leaf[f]
        while node >= 0:
            for k in range(3):
                for axis in range(3):
                    value = s.points[s.faces[f, k], axis]
                    s.tree.low[node, axis] = min(s.tree.low[node, axis], value)
                    s.tree.high[node, axis] = max(s.tree.high[node, axis], value)
            node = s.above[node]


@jit
def patch_hits(s: Any, count: int) -> int:
    """How many faces those of the patch meet, one another included."""
    for n in range(count):
        s.within[s.patch[n]] = True
    total = 0
    for n in range(count):
        if not s.dead[s.patch[n]]:
            total += hits(s, s.patch[n], count)
    for n in range(count):
        s.within[s.patch[n]] = False
    return total


@jit
def hits(s: Any, face: int, count: int) -> int:
    """How many faces one meets, those included that rounding hides.

    The first ``count`` of the patch may be out of their boxes, and are tried each.
    """
    tree = s.tree
    one, two = np.empty((3, 3)), np.empty((3, 3))
    mine, its = np.empty(3, np.int64), np.empty(3, np.int64)
    low, high = np.empty(3), np.empty(3)
    for k in range(3):
        mine[k] = s.faces[face, k]
        one[k] = s.points[s.faces[face, k]]
    corners_box(one, low, high)
    met = 0
    for n in range(count):
        if s.patch[n] != face:
            met += _met(s, s.patch[n], one, mine, low, high, two, its)
    stack = np.zeros(DEPTH, np.int32)
    node, top = next_leaf(tree, low, high, stack, 1)
    while node >= 0:
        for m in range(tree.first[node], tree.first[node] + tree.size[node]):
            other = tree.face[m]
            if other != face and not s.within[other]:
                met += _met(s, other, one, mine, low, high, two, its)
        node, top = next_leaf(tree, low, high, stack, top)
    return met


@jit
def _met(s: Any, other: int, one: Any, mine: Any, low: Any, high: Any, two: Any, its: Any) -> int:
    """1 where a face meets ``other``, else 0."""
    if s.dead[other]:
        return 0
    for k in range(3):
        two[k] = s.points[s.faces[other, k]]
    if boxes_apart(two, low, high):
        return 0
    for k in range(3):
        its[k] = s.faces[other, k]
    return 0 if meeting_kind(one, two, mine, its) == APART else 1
