"""Edges on the wall bent to follow it."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.hemodynamics.three_d.lumen_mesh import EDGES, WALL, LumenMesh, MeshPort
from design.network import FloatArray, IntArray
from design.solids.remesh import LabelledSurface, Shape

_FACE_EDGES: Final = np.array([[0, 1], [1, 2], [2, 0]])

_QUARTER: Final = 0.5 * (1.0 - np.sqrt(1.0 / 3.0))
"""Where an edge's deviation is looked at: Gauss's two places."""


def curved(
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
    key, number = np.unique(pairs[:, 0] * len(points) + pairs[:, 1], return_inverse=True)
    edges = np.column_stack([key // len(points), key % len(points)])
    middle = points[edges].mean(axis=1)
    around, patch = _on_boundary(surface, key, len(points))
    middle[around] = _followed(points[edges[around]], patch, shape)
    node = len(points) + number.reshape(-1, len(EDGES))
    faces = np.column_stack([surface.faces, len(points) + _faces_edges(surface, key, len(points))])
    every = np.concatenate([points, middle])
    return LumenMesh(every, np.column_stack([tets, node]), len(points), faces, surface.label, ports)


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
        for t in (_QUARTER, 1.0 - _QUARTER):
            first, last, bulge = _parabola(t)
            on = first * ends[:, 0] + last * ends[:, 1] + bulge * middle
            gap += 0.5 * (shape.onto(on, patch) - on)
        # The bulge's share of the mean along the edge is 2/3.
        middle = middle + 1.5 * gap
    return middle


def _parabola(t: float) -> tuple[float, float, float]:
    """Weights of the ends and the middle at a share ``t`` of an edge."""
    return (1.0 - t) * (1.0 - 2.0 * t), t * (2.0 * t - 1.0), 4.0 * t * (1.0 - t)
