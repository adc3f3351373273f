"""Kernels: how many faces of a surface being mended meet others."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry.bvh import DEPTH
from design.solids.crossings import APART, meet
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
        mine[k] = s.place[s.faces[face, k]]
        one[k] = s.points[s.faces[face, k]]
    for axis in range(3):
        low[axis] = min(one[0, axis], min(one[1, axis], one[2, axis]))
        high[axis] = max(one[0, axis], max(one[1, axis], one[2, axis]))
    found = 0
    for n in range(count):
        if s.patch[n] != face:
            found += _met(s, s.patch[n], one, mine, low, high, two, its)
    stack = np.empty(DEPTH, np.int32)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        apart = False
        for axis in range(3):
            if low[axis] > tree.high[node, axis] or high[axis] < tree.low[node, axis]:
                apart = True
        if apart:
            continue
        if tree.right[node] >= 0:
            stack[top] = tree.right[node]
            stack[top + 1] = node + 1
            top += 2
            continue
        for m in range(tree.first[node], tree.first[node] + tree.size[node]):
            other = tree.face[m]
            if other != face and not s.within[other]:
                found += _met(s, other, one, mine, low, high, two, its)
    return found


@jit
def _met(s: Any, other: int, one: Any, mine: Any, low: Any, high: Any, two: Any, its: Any) -> int:
    """1 where a face meets ``other``, else 0."""
    if s.dead[other]:
        return 0
    for k in range(3):
        two[k] = s.points[s.faces[other, k]]
    for axis in range(3):
        if max(two[0, axis], max(two[1, axis], two[2, axis])) < low[axis]:
            return 0
        if min(two[0, axis], min(two[1, axis], two[2, axis])) > high[axis]:
            return 0
    for k in range(3):
        its[k] = s.place[s.faces[other, k]]
    return 0 if meet(one, two, mine, its) == APART else 1
