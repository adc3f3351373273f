"""Half-edge structure of a closed triangle surface; edge flip, split and collapse.

Half-edge ``3 t + i`` runs from corner i of triangle t to its next corner; ``twin`` is the one
that runs the other way in the neighbour. Kernels change the arrays in place.
"""

from __future__ import annotations

import numpy as np

from design.errors import SolidError
from design.solids.topology import pair_half_edges
from kernels import jit
from kernels.arrays import IntArray


def twins_of(faces: IntArray) -> IntArray:
    """Return the half-edge opposite each, (3 f,).

    Raises
    ------
    SolidError
        When an edge hasn't exactly two triangles that run along it in opposite directions.
    """
    twin = pair_half_edges(faces)
    if np.any(twin < 0):
        raise SolidError(
            "the surface isn't closed: an edge hasn't two triangles that run along it in opposite "
            "directions; mend it first"
        )
    return twin


def leaving(faces: IntArray, count: int) -> IntArray:
    """Return a half-edge that leaves each of ``count`` vertices; -1 where none does."""
    half_edge = np.full(count, -1, dtype=np.int64)
    half_edge[faces.ravel()] = np.arange(faces.size)
    return half_edge


@jit
def next_half_edge(h: int) -> int:
    """Return the half-edge that follows in the same triangle."""
    return h - 2 if h % 3 == 2 else h + 1


@jit
def previous_half_edge(h: int) -> int:
    """Return the half-edge that comes before in the same triangle."""
    return h + 2 if h % 3 == 0 else h - 1


@jit
def origin(faces: IntArray, h: int) -> int:
    """Return the vertex where a half-edge begins."""
    return int(faces[h // 3, h % 3])


@jit
def tip(faces: IntArray, h: int) -> int:
    """Return the vertex where a half-edge ends."""
    return int(faces[h // 3, (h + 1) % 3])


@jit
def apex(faces: IntArray, h: int) -> int:
    """Return the corner across from a half-edge in its triangle."""
    return int(faces[h // 3, (h + 2) % 3])


@jit
def are_joined(faces: IntArray, twin: IntArray, out: IntArray, a: int, b: int) -> bool:
    """Return whether an edge runs between two vertices."""
    h = out[a]
    while True:
        if tip(faces, h) == b:
            return True
        h = twin[previous_half_edge(h)]
        if h == out[a]:
            return False


@jit
def valence(twin: IntArray, out: IntArray, a: int) -> int:
    """Return the number of edges at a vertex."""
    count, h = 0, out[a]
    while True:
        count += 1
        h = twin[previous_half_edge(h)]
        if h == out[a]:
            return count


@jit
def _pair(twin: IntArray, one: int, two: int) -> None:
    twin[one] = two
    twin[two] = one


@jit
def split_edge(faces: IntArray, twin: IntArray, h: int, vertex: int, first: int) -> None:
    """Put ``vertex`` on an edge; two triangles become four, the new ones ``first`` and the next."""
    t = twin[h]
    here, there, second = h // 3, t // 3, first + 1
    b, c, d = tip(faces, h), apex(faces, h), apex(faces, t)
    beyond_here, beyond_there = twin[next_half_edge(h)], twin[previous_half_edge(t)]
    faces[here, (h + 1) % 3] = vertex
    faces[there, t % 3] = vertex
    faces[first, 0], faces[first, 1], faces[first, 2] = vertex, b, c
    faces[second, 0], faces[second, 1], faces[second, 2] = b, vertex, d
    _pair(twin, 3 * first, 3 * second)
    _pair(twin, 3 * first + 1, beyond_here)
    _pair(twin, 3 * first + 2, next_half_edge(h))
    _pair(twin, 3 * second + 1, previous_half_edge(t))
    _pair(twin, 3 * second + 2, beyond_there)


@jit
def flip(faces: IntArray, twin: IntArray, out: IntArray, h: int) -> None:
    """Turn an edge in the quadrilateral of its two triangles."""
    t = twin[h]
    here, there = h // 3, t // 3
    a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, t)
    ad, ca, bc, db = (
        twin[next_half_edge(t)],
        twin[previous_half_edge(h)],
        twin[next_half_edge(h)],
        twin[previous_half_edge(t)],
    )
    faces[here, 0], faces[here, 1], faces[here, 2] = a, d, c
    faces[there, 0], faces[there, 1], faces[there, 2] = b, c, d
    _pair(twin, 3 * here, ad)
    _pair(twin, 3 * here + 1, 3 * there + 1)
    _pair(twin, 3 * here + 2, ca)
    _pair(twin, 3 * there, bc)
    _pair(twin, 3 * there + 2, db)
    out[a], out[b], out[c], out[d] = 3 * here, 3 * there, 3 * here + 2, 3 * there + 2


@jit
def collapse(faces: IntArray, twin: IntArray, out: IntArray, h: int) -> None:
    """Draw a half-edge's origin into its tip; the caller drops its two triangles."""
    t = twin[h]
    a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, t)
    bc, ca, ad, db = (
        twin[next_half_edge(h)],
        twin[previous_half_edge(h)],
        twin[next_half_edge(t)],
        twin[previous_half_edge(t)],
    )
    g = out[a]
    while True:
        faces[g // 3, g % 3] = b
        g = twin[previous_half_edge(g)]
        if g == out[a]:
            break
    _pair(twin, bc, ca)
    _pair(twin, ad, db)
    out[a], out[b], out[c], out[d] = -1, ca, bc, ad
