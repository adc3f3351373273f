"""Find intersecting triangle pairs that involve newly added triangles of a surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.geometry.boxes import boxes_apart, corners_box, next_leaf
from design.geometry.bvh import TriangleTree, build_triangle_tree
from design.geometry.crossings import APART, Crossings, crossing_pairs, find_crossings, meeting_kind
from design.geometry.hierarchy import DEPTH
from kernels import jit, pjit

_CHUNK = 1024
"""Triangles asked one after another, in room allocated once."""


def find_new_crossings(
    vertices: NDArray[np.float64], faces: NDArray[np.integer], fresh: NDArray[np.bool_]
) -> Crossings:
    """Find all pairs of faces, one of them ``fresh`` at least, that pass through one another.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3)
        As `find_crossings` takes them.
    fresh : (m,) bool
        Few: a tree is made of these alone. Pairs of others aren't tried.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    new, old = np.flatnonzero(fresh), np.flatnonzero(~fresh)
    if len(new) == 0:
        return Crossings(np.empty((0, 2), np.int64))
    tree = build_triangle_tree(vertices, corners[new])
    among = new[find_crossings(vertices, corners[new], tree).pairs]
    one, two = find_meetings(vertices, corners[old], tree, corners[new]).T
    crossed = np.concatenate([among, np.stack([old[one], new[two]], axis=1)])
    crossed = np.sort(crossed, axis=1)
    return Crossings(crossed[np.lexsort(crossed.T[::-1])])


def find_meetings(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    tree: TriangleTree,
    others: NDArray[np.int32],
) -> NDArray[np.int64]:
    """Pairs (k, 2) of one of ``faces`` (m, 3) and one of ``others`` (l, 3) that meet, unsorted.

    Parameters
    ----------
    tree : TriangleTree
        Of ``others``.
    """
    count = np.zeros(len(faces), np.int64)
    none, of = np.empty((0, 2), np.int64), np.empty(0, np.int8)
    chunks = (len(faces) + _CHUNK - 1) // _CHUNK
    _meet(tree, others, vertices, faces, chunks, count, count, none, of)
    some = np.flatnonzero(count)
    begin = np.cumsum(count[some]) - count[some]
    pairs = np.empty((int(count.sum()), 2), np.int64)
    status = np.empty(len(pairs), np.int8)
    met = np.ascontiguousarray(faces[some])
    chunks = (len(met) + _CHUNK - 1) // _CHUNK
    _meet(tree, others, vertices, met, chunks, count[some], begin, pairs, status)
    pairs[:, 0] = some[pairs[:, 0]]
    return crossing_pairs(vertices, faces, others, pairs, status)


@pjit
def _meet(
    tree: Any,
    others: Any,
    vertices: Any,
    faces: Any,
    chunks: int,
    count: Any,
    begin: Any,
    pairs: Any,
    status: Any,
) -> None:
    """Count the others that each face may cross; write them where there is room for pairs."""
    for chunk in prange(chunks):
        one, low, high = np.empty((3, 3)), np.empty(3), np.empty(3)
        stack = np.empty(DEPTH, np.int32)
        first = int(np.int64(chunk)) * _CHUNK
        for n in range(first, min(len(faces), first + _CHUNK)):
            for k in range(3):
                for axis in range(3):
                    one[k, axis] = vertices[faces[n, k], axis]
            corners_box(one, low, high)
            at = begin[n] if len(pairs) > 0 else -1
            count[n] = _met_by(tree, others, one, faces[n], low, high, stack, n, at, pairs, status)


@jit
def _met_by(
    tree: Any,
    others: Any,
    one: Any,
    corners: Any,
    low: Any,
    high: Any,
    stack: Any,
    n: int,
    at: int,
    pairs: Any,
    status: Any,
) -> int:
    """How many others a face (3, 3) may cross; written from ``at`` on where that isn't below 0."""
    count = 0
    stack[0] = 0
    node, top = next_leaf(tree, low, high, stack, int(np.int64(1)))
    while node >= 0:
        for m in range(tree.first[node], tree.first[node] + tree.size[node]):
            two = tree.triangles[m].reshape(3, 3)
            if boxes_apart(two, low, high):
                continue
            met = meeting_kind(one, two, corners, others[tree.face[m]])
            if met == APART:
                continue
            if at >= 0:
                pairs[at + count, 0], pairs[at + count, 1] = n, tree.face[m]
                status[at + count] = met
            count += 1
        node, top = next_leaf(tree, low, high, stack, top)
    return count
