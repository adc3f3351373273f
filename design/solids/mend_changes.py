"""Flip or collapse an edge, or move a vertex, to remove self-intersections (compiled)."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from design.solids.mend_meeting import grow, patch_hits
from design.solids.remesh.halfedges import (
    apex,
    are_joined,
    collapse,
    flip,
    origin,
    previous_half_edge,
    tip,
    valence,
)
from design.solids.remesh.passes import normal, stays_closed
from kernels import jit


@jit
def turn(s: Any, h: int, reach: float, do: bool) -> int:
    """By how many crossings fewer there are when an edge is turned; 0 where it mustn't be."""
    faces, t = s.faces, s.twin[h]
    here, there = h // 3, t // 3
    a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, t)
    if c == d or valence(s.twin, s.out, a) <= 3 or valence(s.twin, s.out, b) <= 3:
        return 0
    if are_joined(faces, s.twin, s.out, c, d) or _thickness(s.points, a, b, c, d) > reach:
        return 0
    s.patch[0], s.patch[1] = here, there
    now = patch_hits(s, 2)
    mine, its = faces[here].copy(), faces[there].copy()
    if do:
        flip(faces, s.twin, s.out, h)
        grow(s, 2)
        return 0
    faces[here, 0], faces[here, 1], faces[here, 2] = a, d, c
    faces[there, 0], faces[there, 1], faces[there, 2] = b, c, d
    then = patch_hits(s, 2)
    faces[here], faces[there] = mine, its
    return now - then


@jit
def draw_in(s: Any, h: int, reach: float, do: bool) -> int:
    """The same for a half-edge whose origin is drawn into its tip."""
    faces, dead = s.faces, s.dead
    one, two = h // 3, s.twin[h] // 3
    a, b = origin(faces, h), tip(faces, h)
    count = _around(s, a)
    if count == 0 or not stays_closed(faces, s.twin, s.out, h):
        return 0
    g = h
    for _ in range(count):
        p, q = tip(faces, g), apex(faces, g)
        if p != b and q != b and not _may_turn(s.points, a, b, p, q, reach):
            return 0
        g = s.twin[previous_half_edge(g)]
    if do:
        collapse(faces, s.twin, s.out, h)
        dead[one] = dead[two] = True
        grow(s, count)
        return 0
    now = patch_hits(s, count)
    _rename(s, count, a, b)
    dead[one] = dead[two] = True
    then = patch_hits(s, count)
    dead[one] = dead[two] = False
    g = h
    for _ in range(count):
        faces[g // 3, g % 3] = a
        g = s.twin[previous_half_edge(g)]
    return now - then


@jit
def _rename(s: Any, count: int, a: int, b: int) -> None:
    for n in range(count):
        for k in range(3):
            if s.faces[s.patch[n], k] == a:
                s.faces[s.patch[n], k] = b


@jit
def move(s: Any, a: int, way: int, reach: float, step: float, do: bool) -> int:
    """The same for a vertex moved along its normal: outwards for even ``way``, inwards for odd."""
    points, count = s.points, _around(s, a)
    length = 2.0 * 4.0 ** (way // 2) * step
    if count == 0 or length > reach:
        return 0
    nx = ny = nz = 0.0
    for n in range(count):
        f = s.patch[n]
        x, y, z = normal(points, s.faces[f, 0], s.faces[f, 1], s.faces[f, 2])
        nx, ny, nz = nx + x, ny + y, nz + z
    size = sqrt(nx * nx + ny * ny + nz * nz)
    if size == 0.0:
        return 0
    share = (length if way % 2 == 0 else -length) / size
    now = patch_hits(s, count)
    x, y, z = points[a, 0], points[a, 1], points[a, 2]
    points[a, 0] = np.float32(x + share * nx)
    points[a, 1] = np.float32(y + share * ny)
    points[a, 2] = np.float32(z + share * nz)
    if do:
        grow(s, count)
        return 0
    then = patch_hits(s, count)
    points[a, 0], points[a, 1], points[a, 2] = x, y, z
    return now - then


@jit
def _around(s: Any, a: int) -> int:
    """Write the faces around a vertex into the patch; 0 where they are too many."""
    count, g = 0, s.out[a]
    while True:
        if count == len(s.patch):
            return 0
        s.patch[count] = g // 3
        count += 1
        g = s.twin[previous_half_edge(g)]
        if g == s.out[a]:
            return count


@jit
def _thickness(points: Any, a: int, b: int, c: int, d: int) -> float:
    """Least height of a tetrahedron: six times its volume over twice its largest face."""
    x, y, z = normal(points, a, b, c)
    volume = abs(
        x * (points[d, 0] - points[a, 0])
        + y * (points[d, 1] - points[a, 1])
        + z * (points[d, 2] - points[a, 2])
    )
    largest = x * x + y * y + z * z
    for p, q, r in ((a, b, d), (b, c, d), (c, a, d)):
        x, y, z = normal(points, p, q, r)
        largest = max(largest, x * x + y * y + z * z)
    return volume / sqrt(largest) if largest > 0.0 else 0.0


@jit
def _may_turn(points: Any, a: int, b: int, p: int, q: int, reach: float) -> bool:
    """Whether the face apq may become bpq: near it, and not turned over unless it is a sliver."""
    if _thickness(points, a, b, p, q) > reach:
        return False
    x, y, z = normal(points, a, p, q)
    u, v, w = normal(points, b, p, q)
    if x * u + y * v + z * w > 0.0:
        return True
    longest = 0.0
    for i, j in ((a, p), (p, q), (q, a), (b, p), (q, b)):
        for k in range(3):
            longest = max(longest, abs(points[i, k] - points[j, k]))
    area = min(x * x + y * y + z * z, u * u + v * v + w * w)
    return sqrt(area) <= reach * longest
