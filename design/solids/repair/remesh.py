"""Remesh surfaces with even, nearly equilateral triangles.

Goes in: a closed surface and wanted edge lengths. Comes out: the same surface of even triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Final, NamedTuple, Protocol

import numpy as np

from design.errors import SolidError
from design.geometry.surface import Surface
from design.solids.repair.half_edges import (
    apex,
    are_joined,
    collapse,
    flip,
    leaving,
    origin,
    previous_half_edge,
    split_edge,
    tip,
    twins_of,
    valence,
)
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class _Limits(NamedTuple):
    """Limits of remeshing."""

    rounds: int = 10  # of splitting, drawing in, turning and relaxing
    splits: int = 30  # passes of splitting in one round
    growth: float = 0.4  # of the wanted length, per mm along the surface
    long: float = 4.0 / 3.0  # of the wanted length: longer edges are split
    short: float = 4.0 / 5.0  # of the wanted length: shorter edges are drawn in
    turn: float = 0.5  # least cosine of the angle by which a triangle may turn
    poor: float = 0.05  # quality below which a triangle may only get better
    gain: float = 1e-3  # of the worse of two triangles, for their edge to be turned
    relaxation: float = 0.7  # of the way to the neighbours' middle


_LIMITS: Final = _Limits()


@dataclass(frozen=True)
class LabelledSurface(Surface):
    """A closed triangle surface with labelled faces.

    Attributes
    ----------
    vertices : (n, 3) float64, mm
    faces : (f, 3) int64
        Outward by the right hand.
    label : (f,) int64
        Faces of one label are a smooth patch; patches meet in rims, which remeshing keeps.
    """

    faces: IntArray
    label: IntArray


class Shape(Protocol):
    """Shape that a remeshed surface follows."""

    def size(self, points: FloatArray) -> FloatArray:
        """Return the wanted edge length at each point, (n,), mm."""
        ...

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        """Move points (n, 3) onto the shape.

        ``patch`` (n,) is the label of the patch that a point lies in; -1 - label on a rim, with
        the larger of the labels that meet there.
        """
        ...


def remesh(surface: LabelledSurface, shape: Shape) -> LabelledSurface:
    """Remesh a surface with nearly equilateral triangles that follow ``shape``.

    Parameters
    ----------
    surface : LabelledSurface
        Near enough to the shape for `Shape.onto`, and of its topology.
    shape : Shape

    Returns
    -------
    LabelledSurface
        Of the same number of handles and the same rims.

    Raises
    ------
    SolidError
        When the surface isn't closed, or a wanted length isn't above 0.
    """
    for _ in range(_LIMITS.rounds):
        surface = _turned(_drawn_in(_split(surface, shape), shape))
        surface = _relaxed(surface, shape)
    return surface


def patches(surface: LabelledSurface) -> IntArray:
    """Return the patch of each vertex, as `Shape.onto` takes it, (n,)."""
    low = np.full(len(surface.vertices), np.iinfo(np.int64).max)
    high = np.full(len(surface.vertices), -1)
    for corner in surface.faces.T:
        np.minimum.at(low, corner, surface.label)
        np.maximum.at(high, corner, surface.label)
    return np.where(low == high, low, -1 - high)


def _wanted(surface: LabelledSurface, shape: Shape) -> FloatArray:
    wanted = np.ascontiguousarray(shape.size(surface.vertices), dtype=np.float64)
    if not (np.isfinite(wanted).all() and (wanted > 0.0).all()):
        bad = int(np.flatnonzero(~(np.isfinite(wanted) & (wanted > 0.0)))[0])
        x, y, z = surface.vertices[bad]
        raise SolidError(
            f"the wanted edge length at {x:.4g}, {y:.4g}, {z:.4g} mm is {wanted[bad]:g} mm; the "
            "surface must lie near its shape, and lengths be above 0"
        )
    level(surface.vertices, surface.faces, wanted, _LIMITS.growth)
    return wanted


def _split(surface: LabelledSurface, shape: Shape) -> LabelledSurface:
    for _ in range(_LIMITS.splits):
        n, f = len(surface.vertices), len(surface.faces)
        wanted = _wanted(surface, shape)
        # For each edge once; halves that are still too long come in the next pass.
        points, room = np.zeros((n + 3 * f // 2, 3)), f + 3 * f
        faces, label = np.zeros((room, 3), np.int64), np.zeros(room, np.int64)
        twin, sizes = np.zeros(3 * room, np.int64), np.zeros(len(points))
        points[:n], sizes[:n], faces[:f] = surface.vertices, wanted, surface.faces
        label[:f], twin[: 3 * f] = surface.label, twins_of(surface.faces)
        n2, f2 = split_long(points, sizes, faces, label, twin, n, f)
        surface = LabelledSurface(points[:n2].copy(), faces[:f2].copy(), label[:f2].copy())
        if f2 == f:
            break
    return surface


def _drawn_in(surface: LabelledSurface, shape: Shape) -> LabelledSurface:
    faces, count = surface.faces.copy(), len(surface.vertices)
    twin, out = twins_of(faces), leaving(faces, count)
    rim, dead = np.zeros(count, np.int64), np.zeros(len(faces), np.int64)
    rims(faces, twin, surface.label, rim)
    wanted = _wanted(surface, shape)
    draw_in_short(surface.vertices, wanted, faces, surface.label, twin, out, rim, dead)
    return _packed(surface.vertices, faces[dead == 0], surface.label[dead == 0])


def _packed(points: FloatArray, faces: IntArray, label: IntArray) -> LabelledSurface:
    used, place = np.unique(faces, return_inverse=True)
    return LabelledSurface(points[used], place.reshape(-1, 3).astype(np.int64), label)


def _turned(surface: LabelledSurface) -> LabelledSurface:
    faces = surface.faces.copy()
    twin, out = twins_of(faces), leaving(faces, len(surface.vertices))
    for _ in range(3):
        if turn(surface.vertices, faces, surface.label, twin, out) == 0:
            break
    return LabelledSurface(surface.vertices, faces, surface.label)


def _relaxed(surface: LabelledSurface, shape: Shape) -> LabelledSurface:
    count = len(surface.vertices)
    twin, out = twins_of(surface.faces), leaving(surface.faces, count)
    rim, moved = np.zeros(count, np.int64), np.empty((count, 3))
    rims(surface.faces, twin, surface.label, rim)
    relax(surface.vertices, surface.faces, surface.label, twin, out, rim, moved)
    points = shape.onto(moved, patches(surface))
    return LabelledSurface(np.ascontiguousarray(points), surface.faces, surface.label)


# The scheme of Botsch & Kobbelt 2004 ("A remeshing approach to multiresolution modeling"), with a
# wanted length at every vertex, and with rims between labels that stay.
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
    """Return the outward normal, twice the triangle's area long."""
    ux, vx = points[b, 0] - points[a, 0], points[c, 0] - points[a, 0]
    uy, vy = points[b, 1] - points[a, 1], points[c, 1] - points[a, 1]
    uz, vz = points[b, 2] - points[a, 2], points[c, 2] - points[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit
def quality(points: FloatArray, a: int, b: int, c: int) -> float:
    """Return the area over that of an equilateral triangle of the same squared edges: 1 at best."""
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
    """Split edges that are too long while the arrays have room; return the new counts."""
    for h in range(3 * triangles):
        if vertices == len(points) or triangles + 2 > len(faces):
            break
        if twin[h] < h:
            continue
        a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, twin[h])
        length = _length(points, a, b)
        if length <= _LIMITS.long * 0.5 * (wanted[a] + wanted[b]):
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
    """Return whether drawing in a half-edge turns no triangle far, nor makes an edge too long."""
    a, b = origin(faces, h), tip(faces, h)
    g = out[a]
    while True:
        p, q = tip(faces, g), apex(faces, g)
        if p != b and q != b:
            x, y, z = normal(points, a, p, q)
            u, v, w = normal(points, b, p, q)
            size = sqrt((x * x + y * y + z * z) * (u * u + v * v + w * w))
            if x * u + y * v + z * w < _LIMITS.turn * size or size == 0.0:
                return False
            if quality(points, b, p, q) < min(_LIMITS.poor, quality(points, a, p, q)):
                return False
            if _length(points, b, p) > _LIMITS.long * 0.5 * (wanted[b] + wanted[p]):
                return False
        g = twin[previous_half_edge(g)]
        if g == out[a]:
            return True


@jit
def stays_closed(faces: IntArray, twin: IntArray, out: IntArray, h: int) -> bool:
    """Check the link condition: an edge's ends share just the two corners across from it."""
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
    """Draw in edges that are too short, rims along themselves alone; return how many."""
    count = 0
    for h in range(3 * len(faces)):
        if dead[h // 3]:
            continue
        a, b = origin(faces, h), tip(faces, h)
        if _length(points, a, b) >= _LIMITS.short * 0.5 * (wanted[a] + wanted[b]):
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
    """Turn edges where the worse of the two triangles gets better; return how many."""
    count = 0
    for h in range(3 * len(faces)):
        t = twin[h]
        if t < h or label[h // 3] != label[t // 3]:
            continue
        a, b, c, d = origin(faces, h), tip(faces, h), apex(faces, h), apex(faces, t)
        now = min(quality(points, a, b, c), quality(points, b, a, d))
        then = min(quality(points, a, d, c), quality(points, b, c, d))
        if then < now + _LIMITS.gain or valence(twin, out, a) <= 3 or valence(twin, out, b) <= 3:
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
        share = _LIMITS.relaxation if rim[a] in (0, 2) else 0.0
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
