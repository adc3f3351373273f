"""Faces of a surface that pass through one another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.geometry import build_triangle_tree
from design.geometry.bvh import DEPTH
from design.geometry.segment_surface import pierces
from kernels import jit


def crossing_faces(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """Pairs of faces (k, 2) that pass through one another.

    Faces that share a vertex aren't tried.
    """
    tree = build_triangle_tree(vertices, faces)
    room = 1024
    while True:
        pairs = np.empty((room, 2), np.int64)
        found = _cross(tree, np.ascontiguousarray(faces), pairs)
        if found <= room:
            return pairs[:found]
        room = found


@jit
def _cross(tree: Any, faces: Any, pairs: Any) -> int:
    """Write pairs while there is room; return how many there are."""
    found = 0
    stack = np.empty(DEPTH, np.int32)
    low, high = np.empty(3), np.empty(3)
    for n in range(len(tree.triangles)):
        one = tree.triangles[n]
        for axis in range(3):
            low[axis] = min(one[axis], min(one[3 + axis], one[6 + axis]))
            high[axis] = max(one[axis], max(one[3 + axis], one[6 + axis]))
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
                if m > n and _pass_through(tree, faces, n, m):
                    if found < len(pairs):
                        pairs[found, 0], pairs[found, 1] = tree.face[n], tree.face[m]
                    found += 1
    return found


@jit
def _pass_through(tree: Any, faces: Any, n: int, m: int) -> bool:
    for p in range(3):
        for q in range(3):
            if faces[tree.face[n], p] == faces[tree.face[m], q]:
                return False
    one, two = tree.triangles[n], tree.triangles[m]
    for edge in range(3):
        i, j = 3 * edge, 3 * ((edge + 1) % 3)
        if pierces(one[i], one[i + 1], one[i + 2], one[j], one[j + 1], one[j + 2], two):
            return True
        if pierces(two[i], two[i + 1], two[i + 2], two[j], two[j + 1], two[j + 2], one):
            return True
    return False
