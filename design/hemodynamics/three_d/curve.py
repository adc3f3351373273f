"""Curve the mesh edges on a lumen's wall by moving their middle nodes onto it."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.hemodynamics.three_d.lagrange import quadratic, triangle_rule
from design.hemodynamics.three_d.lumen_mesh import EDGES, WALL, LumenMesh, MeshPort
from design.solids.remesh import LabelledSurface, Shape
from kernels.arrays import FloatArray, IntArray

_FACE_EDGES: Final = np.array([[0, 1], [1, 2], [2, 0]])

_ALONG: Final = tuple(zip(*np.polynomial.legendre.leggauss(3), strict=True))
"""Where an edge's deviation is looked at, and the weights: Gauss's three places. The deviation
of a parabola from an arc is of fourth degree; two places leave areas 0.03 % too large."""

_LEVELLINGS: Final = 3
"""Rounds after which faces lie on the shape in the mean, to some 1e-5 of a radius."""


def curve_edges(
    surface: LabelledSurface,
    points: FloatArray,
    tets: IntArray,
    shape: Shape,
    ports: tuple[MeshPort, ...],
) -> LumenMesh:
    """Give every edge its middle node; those on the wall follow ``shape``.

    A parabola through three places of an arc lies inside it in between. The middle is moved out
    by as much again as makes the edge's mean distance from the shape vanish, so that lumens keep
    their size: without, a lumen of eight edges around loses 0.2 % of its conductance.

    Parameters
    ----------
    surface : LabelledSurface
        The boundary of the tetrahedra.
    points : (n, 3) float64, mm
        Those of the surface first.
    tets : (t, 4) int64
    shape : Shape
    ports : tuple of MeshPort
    """
    pairs = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1)
    count = len(points)
    key, number = np.unique(pairs[:, 0] * count + pairs[:, 1], return_inverse=True)
    edges = np.column_stack([key // count, key % count])
    middle = points[edges].mean(axis=1)
    around, patch = _on_boundary(surface, key, count)
    middle[around] = _followed(points[edges[around]], patch, shape)
    node = count + number.reshape(-1, len(EDGES))
    faces = np.column_stack([surface.faces, count + _faces_edges(surface, key, count)])
    every = np.concatenate([points, middle])
    _level(every, faces[surface.label == WALL], count + around[patch == WALL], shape)
    return LumenMesh(every, np.column_stack([tets, node]), count, faces, surface.label, ports)


def _keys(surface: LabelledSurface, count: int) -> IntArray:
    """Number of each face's edges, (f, 3)."""
    ends = np.sort(surface.faces[:, _FACE_EDGES], axis=2)
    return np.asarray(ends[..., 0] * count + ends[..., 1], dtype=np.int64)


def _faces_edges(surface: LabelledSurface, key: IntArray, count: int) -> IntArray:
    return np.searchsorted(key, _keys(surface, count))


def _on_boundary(surface: LabelledSurface, key: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Edges on the wall or a rim, and the patch of each, as `Shape.onto` takes it."""
    number = _faces_edges(surface, key, count).ravel()
    label = np.repeat(surface.label, 3)
    low, high = np.full(len(key), np.iinfo(np.int64).max), np.full(len(key), -1)
    np.minimum.at(low, number, label)
    np.maximum.at(high, number, label)
    around = np.flatnonzero(low == WALL)
    return around, np.where(low == high, low, -1 - high)[around]


def _followed(ends: FloatArray, patch: IntArray, shape: Shape) -> FloatArray:
    """Middles of edges (e, 2, 3) such that their parabolas lie on the shape in the mean."""
    middle = shape.onto(ends.mean(axis=1), patch)
    for _ in range(2):
        gap = np.zeros_like(middle)
        for place, weight in _ALONG:
            first, last, bulge = _parabola(0.5 * (1.0 + place))
            on = first * ends[:, 0] + last * ends[:, 1] + bulge * middle
            gap += 0.5 * weight * (shape.onto(on, patch) - on)
        # The bulge's share of the mean along the edge is 2/3.
        middle = middle + 1.5 * gap
    return middle


def _parabola(t: float) -> tuple[float, float, float]:
    """Weights of the ends and the middle at a share ``t`` of an edge."""
    return (1.0 - t) * (1.0 - 2.0 * t), t * (2.0 * t - 1.0), 4.0 * t * (1.0 - t)


def _level(points: FloatArray, faces: IntArray, free: IntArray, shape: Shape) -> None:
    """Move the ``free`` middles until faces (f, 6), too, lie on the shape in the mean.

    Edges that do leave the faces between them bulging, by 0.02 % of a lumen's volume. A face
    follows its three middles as a whole (each has a third of its mean): each goes by the mean of
    what its two faces are off. Rims stay, and with them the ports' areas.
    """
    at, weight = triangle_rule()
    value = quadratic(np.column_stack([at, np.zeros(len(at))]))[0][:, [0, 1, 2, 4, 5, 6]]
    wall = np.full(len(at) * len(faces), WALL)
    for _ in range(_LEVELLINGS):
        on = np.einsum("qn,fnx->fqx", value, points[faces])
        moved = shape.onto(on.reshape(-1, 3), wall).reshape(on.shape)
        gap = np.einsum("q,fqx->fx", weight, moved - on)
        step = np.zeros_like(points)
        np.add.at(step, faces[:, 3:], 0.5 * gap[:, None, :])
        points[free] += step[free]
