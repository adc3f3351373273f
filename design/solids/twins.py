"""Pair the half-edges of a triangle mesh; count fans and shells of a closed one (compiled).

Half-edge 3 t + i runs from corner i of triangle t to its next corner. Sorted by the lesser of its
two vertices, an edge's sides stand among a dozen others: no sort of all keys is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import IntArray


def pair_half_edges(faces: NDArray[np.integer]) -> IntArray:
    """The half-edge opposite each of ``faces`` (m, 3), (3 m,).

    -1 where an edge hasn't exactly two sides that run along it in opposite directions.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int64)
    return np.asarray(_pair(corners, int(corners.max(initial=-1)) + 1))


@jit
def _pair(faces: Any, count: int) -> Any:
    """As `pair_half_edges`; ``count`` vertices."""
    begin = np.zeros(count + 1, np.int64)
    for t in range(len(faces)):
        for i in range(3):
            begin[min(faces[t, i], faces[t, (i + 1) % 3]) + 1] += 1
    for v in range(count):
        begin[v + 1] += begin[v]
    place = begin[:-1].copy()
    half, other = np.empty(3 * len(faces), np.int64), np.empty(3 * len(faces), np.int64)
    for t in range(len(faces)):
        for i in range(3):
            tail, head = faces[t, i], faces[t, (i + 1) % 3]
            at = place[min(tail, head)]
            place[min(tail, head)] += 1
            half[at], other[at] = 3 * t + i, max(tail, head)
    twin = np.full(3 * len(faces), -1, np.int64)
    for v in range(count):
        for m in range(begin[v], begin[v + 1]):
            partner, sides = np.int64(-1), 0
            for n in range(begin[v], begin[v + 1]):
                if other[n] == other[m]:
                    sides += 1
                    if n != m:
                        partner = half[n]
            h = half[m]
            if sides == 2 and faces[h // 3, h % 3] == faces[partner // 3, (partner + 1) % 3]:
                # An edge from a vertex to itself has no opposite side.
                twin[h] = partner if other[m] != v else -1
    return twin


@jit
def corner_fan_numbers(twin: Any) -> tuple[Any, int]:
    """Number of the fan about its vertex that each corner (3 m,) belongs to, and how many.

    ``twin`` (3 m,) pairs all half-edges.
    """
    fan = np.full(len(twin), -1, np.int64)
    count = 0
    for h in range(len(twin)):
        if fan[h] >= 0:
            continue
        at = h
        while fan[at] < 0:
            fan[at] = count
            at = twin[at + 2 if at % 3 == 0 else at - 1]
        count += 1
    return fan, count


@jit
def count_shells(twin: Any) -> int:
    """How many closed surfaces the faces make that aren't joined over an edge."""
    faces = len(twin) // 3
    seen = np.zeros(faces, np.bool_)
    stack = np.empty(faces, np.int64)
    count = 0
    for start in range(faces):
        if seen[start]:
            continue
        count += 1
        seen[start] = True
        stack[0], top = start, 1
        while top > 0:
            top -= 1
            t = stack[top]
            for i in range(3):
                after = twin[3 * t + i] // 3
                if not seen[after]:
                    seen[after] = True
                    stack[top] = after
                    top += 1
    return count
