"""Remesh steps on a triangle surface: split, collapse or flip edges, relax vertices.

The scheme of Botsch & Kobbelt 2004 ("A remeshing approach to multiresolution modeling"), with a
wanted length at every vertex, and with rims between labels that stay.
"""

from __future__ import annotations

from math import sqrt

from design.solids.remesh.halfedges import (
    apex,
    are_joined,
    collapse,
    flip,
    origin,
    previous_half_edge,
    split_edge,
    tip,
    valence,
)
from kernels import jit
from kernels.arrays import FloatArray, IntArray

LONG = 4.0 / 3.0
"""Of the wanted length: a longer edge is split."""

SHORT = 4.0 / 5.0
"""Of the wanted length: a shorter edge is drawn in."""

_TURN = 0.5
"""Least cosine of the angle by which a triangle may turn."""

_POOR = 0.05
"""Quality below which a triangle may only get better."""

_GAIN = 1e-3
"""By which the worse of two triangles must gain for their edge to be turned."""


@jit
def _length(points: FloatArray, a: int, b: int) -> float:
    dx, dy, dz = (
        points[a, 0] - points[b, 0],
        points[a, 1] - points[b, 1],
        points[a, 2] - points[b, 2],
    )
    return sqrt(dx * dx + dy * dy + dz * dz)


@jit
def normal(points: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Outward, twice the triangle's area long."""
    ux, vx = points[b, 0] - points[a, 0], points[c, 0] - points[a, 0]
    uy, vy = points[b, 1] - points[a, 1], points[c, 1] - points[a, 1]
    uz, vz = points[b, 2] - points[a, 2], points[c, 2] - points[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit
def quality(points: FloatArray, a: int, b: int, c: int) -> float:
    """Area over what an equilateral triangle with the same squared edges has: 1 at best."""
    x, y, z = normal(points, a, b, c)
    edges = _length(points, a, b) ** 2 + _length(points, b, c) ** 2 + _length(points, c, a) ** 2
    return 2.0 * sqrt(3.0) * sqrt(x * x + y * y + z * z) / max(edges, 1e-300)


@jit
def rims(faces: IntArray, twin: IntArray, label: IntArray, rim: IntArray) -> None:
    """Count into ``rim`` the edges between two labels at each vertex."""
    rim[:] = 0
    for h in range(3 * len(faces)):
        if label[h // 3] != label[twin[h] // 3]:
            rim[origin(faces, h)] += 1


@jit
def split_long(
    points: FloatArray,
    wanted: FloatArray,
    faces: IntArray,
    label: IntArray,
    twin: IntArray,
    vertices: int,
    triangles: int,
) -> tuple[int, int]:
    """Split edges that are too long while the arrays have room. New counts."""
    for h in range(3 * triangles):
        if vertices == len(points) or triangles + 2 > len(faces):
            break
        if twin[h] < h:
            continue
        a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, twin[h])
        length = _length(points, a, b)
        if length <= LONG * 0.5 * (wanted[a] + wanted[b]):
            continue
        # The longest of its triangles alone (Rivara): others leave needles.
        others = max(_length(points, b, c), _length(points, c, a))
        others = max(others, _length(points, a, d), _length(points, d, b))
        if length < others * (1.0 - 1e-9):
            continue
        label[triangles], label[triangles + 1] = label[h // 3], label[twin[h] // 3]
        for k in range(3):
            points[vertices, k] = 0.5 * (points[a, k] + points[b, k])
        wanted[vertices] = 0.5 * (wanted[a] + wanted[b])
        split_edge(faces, twin, h, vertices, triangles)
        vertices += 1
        triangles += 2
    return vertices, triangles


@jit
def _keeps_form(
    points: FloatArray, wanted: FloatArray, faces: IntArray, twin: IntArray, out: IntArray, h: int
) -> bool:
    """Whether drawing in a half-edge turns no triangle far, nor makes an edge too long."""
    a, b = origin(faces, h), tip(faces, h)
    g = out[a]
    while True:
        p, q = tip(faces, g), apex(faces, g)
        if p != b and q != b:
            x, y, z = normal(points, a, p, q)
            u, v, w = normal(points, b, p, q)
            size = sqrt((x * x + y * y + z * z) * (u * u + v * v + w * w))
            if x * u + y * v + z * w < _TURN * size or size == 0.0:
                return False
            if quality(points, b, p, q) < min(_POOR, quality(points, a, p, q)):
                return False
            if _length(points, b, p) > LONG * 0.5 * (wanted[b] + wanted[p]):
                return False
        g = twin[previous_half_edge(g)]
        if g == out[a]:
            return True


@jit
def stays_closed(faces: IntArray, twin: IntArray, out: IntArray, h: int) -> bool:
    """The link condition: the ends of an edge share just the two corners across from it."""
    a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, twin[h])
    if c == d or valence(twin, out, c) <= 3 or valence(twin, out, d) <= 3:
        return False
    g = out[a]
    while True:
        p = tip(faces, g)
        if p not in (b, c, d) and are_joined(faces, twin, out, p, b):
            return False
        g = twin[previous_half_edge(g)]
        if g == out[a]:
            return True


@jit
def draw_in_short(
    points: FloatArray,
    wanted: FloatArray,
    faces: IntArray,
    label: IntArray,
    twin: IntArray,
    out: IntArray,
    rim: IntArray,
    dead: IntArray,
) -> int:
    """Draw in edges that are too short, rims along themselves alone. How many."""
    count = 0
    for h in range(3 * len(faces)):
        if dead[h // 3]:
            continue
        a, b = origin(faces, h), tip(faces, h)
        if _length(points, a, b) >= SHORT * 0.5 * (wanted[a] + wanted[b]):
            continue
        between = label[h // 3] != label[twin[h] // 3]
        if rim[a] > 0 and not (between and rim[a] == 2 and rim[b] == 2):
            continue
        if not stays_closed(faces, twin, out, h):
            continue
        if not _keeps_form(points, wanted, faces, twin, out, h):
            continue
        dead[h // 3] = dead[twin[h] // 3] = 1
        collapse(faces, twin, out, h)
        count += 1
    return count


@jit
def turn(
    points: FloatArray, faces: IntArray, label: IntArray, twin: IntArray, out: IntArray
) -> int:
    """Turn edges where the worse of the two triangles gets better. How many."""
    count = 0
    for h in range(3 * len(faces)):
        t = twin[h]
        if t < h or label[h // 3] != label[t // 3]:
            continue
        a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, t)
        now = min(quality(points, a, b, c), quality(points, b, a, d))
        then = min(quality(points, a, d, c), quality(points, b, c, d))
        if then < now + _GAIN or valence(twin, out, a) <= 3 or valence(twin, out, b) <= 3:
            continue
        x, y, z = normal(points, a, d, c)
        u, v, w = normal(points, b, c, d)
        p, q, r = normal(points, a, b, c)
        i, j, k = normal(points, b, a, d)
        nx, ny, nz = p + i, q + j, r + k
        if x * nx + y * ny + z * nz <= 0.0 or u * nx + v * ny + w * nz <= 0.0:
            continue
        if x * u + y * v + z * w <= 0.0 < p * i + q * j + r * k:
            continue
        if are_joined(faces, twin, out, c, d):
            continue
        flip(faces, twin, out, h)
        count += 1
    return count


@jit
def relax(
    points: FloatArray,
    faces: IntArray,
    label: IntArray,
    twin: IntArray,
    out: IntArray,
    rim: IntArray,
    moved: FloatArray,
) -> None:
    """Move each vertex along the surface to its neighbours' middle, on a rim along the rim."""
    for a in range(len(out)):
        sx = sy = sz = weight = nx = ny = nz = 0.0
        g = out[a]
        while True:
            p = tip(faces, g)
            if rim[a] == 0 or label[g // 3] != label[twin[g] // 3]:
                sx, sy, sz = sx + points[p, 0], sy + points[p, 1], sz + points[p, 2]
                weight += 1.0
            x, y, z = normal(points, a, p, apex(faces, g))
            nx, ny, nz = nx + x, ny + y, nz + z
            g = twin[previous_half_edge(g)]
            if g == out[a]:
                break
        dx, dy, dz = (
            sx / weight - points[a, 0],
            sy / weight - points[a, 1],
            sz / weight - points[a, 2],
        )
        if rim[a] == 0:
            away = (dx * nx + dy * ny + dz * nz) / max(nx * nx + ny * ny + nz * nz, 1e-300)
            dx, dy, dz = dx - away * nx, dy - away * ny, dz - away * nz
        share = 0.7 if rim[a] in (0, 2) else 0.0
        moved[a, 0] = points[a, 0] + share * dx
        moved[a, 1] = points[a, 1] + share * dy
        moved[a, 2] = points[a, 2] + share * dz


@jit
def level(points: FloatArray, faces: IntArray, wanted: FloatArray, growth: float) -> None:
    """Lower wanted lengths until none grows by more than ``growth`` per mm along an edge."""
    changed = True
    while changed:
        changed = False
        for h in range(3 * len(faces)):
            a, b = origin(faces, h), tip(faces, h)
            most = wanted[a] + growth * _length(points, a, b)
            if wanted[b] > most * (1.0 + 1e-9):
                wanted[b] = most
                changed = True
