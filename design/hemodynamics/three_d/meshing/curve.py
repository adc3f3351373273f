"""Curve the mesh edges on a lumen's wall by moving their middle nodes onto it."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement, product
from math import factorial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.meshing.lumen_mesh import (
    EDGES,
    WALL,
    LumenMesh,
    MeshPort,
    quadratic,
    triangle_rule,
)
from design.solids.repair.remesh import LabelledSurface, Shape
from kernels.arrays import FloatArray, IntArray

_FACE_EDGES: Final = np.array([[0, 1], [1, 2], [2, 0]])
_GAUSS: Final = tuple(zip(*np.polynomial.legendre.leggauss(3), strict=True))
"""Places and weights at which an edge's deviation is measured. The deviation of a parabola from an
arc is of fourth degree; two places leave areas 0.03 % too large."""
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
    until the edge's mean distance from the shape vanishes: without that, a lumen of eight edges
    around loses 0.2 % of its conductance. ``points`` (n, 3) begin with those of the tetrahedra's
    boundary ``surface``.
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


def _faces_edges(surface: LabelledSurface, key: IntArray, count: int) -> IntArray:
    """Return the number of each face's edges, (f, 3)."""
    ends = np.sort(surface.faces[:, _FACE_EDGES], axis=2)
    return np.searchsorted(key, ends[..., 0] * count + ends[..., 1])


def _on_boundary(surface: LabelledSurface, key: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the edges on the wall or a rim, and the patch of each, as `Shape.onto` takes it."""
    number = _faces_edges(surface, key, count).ravel()
    label = np.repeat(surface.label, 3)
    low, high = np.full(len(key), np.iinfo(np.int64).max), np.full(len(key), -1)
    np.minimum.at(low, number, label)
    np.maximum.at(high, number, label)
    around = np.flatnonzero(low == WALL)
    return around, np.where(low == high, low, -1 - high)[around]


def _followed(ends: FloatArray, patch: IntArray, shape: Shape) -> FloatArray:
    """Place middles of edges (e, 2, 3) so that their parabolas lie on the shape in the mean."""
    middle = shape.onto(ends.mean(axis=1), patch)
    for _ in range(2):
        gap = np.zeros_like(middle)
        for place, weight in _GAUSS:
            t = 0.5 * (1.0 + place)
            first, last = (1.0 - t) * (1.0 - 2.0 * t), t * (2.0 * t - 1.0)
            on = first * ends[:, 0] + last * ends[:, 1] + 4.0 * t * (1.0 - t) * middle
            gap += 0.5 * weight * (shape.onto(on, patch) - on)
        # The bulge's share of the mean along the edge is 2/3.
        middle = middle + 1.5 * gap
    return middle


def _level(points: FloatArray, faces: IntArray, free: IntArray, shape: Shape) -> None:
    """Move the ``free`` middles until faces (f, 6), too, lie on the shape in the mean.

    Without it faces bulge by 0.02 % of a lumen's volume. A middle moves by the mean of its two
    faces' distances. Rims stay, and with them the ports' areas.
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


LEAST: Final = 0.05
"""Least Bernstein coefficient over the straight element's determinant that isn't straightened."""
_HALVINGS: Final = 4
"""Of an edge's bulge, before it is made straight."""
_CHUNK: Final = 20_000
"""Elements at a time, to save memory."""


def least_jacobian(mesh: LumenMesh) -> FloatArray:
    """Bound each element's Jacobian over that of the straight one, (t,), from below; 1 if straight.

    Positive where the element is mapped one to one for certain. A quadratic tetrahedron's Jacobian
    determinant is a cubic, which lies between the least and the greatest of its 20 Bernstein
    coefficients (Johnen, Remacle & Geuzaine 2013, doi 10.1016/j.jcp.2012.08.051).

    Raises
    ------
    FlowError
        An element that is flat or inverted as its corners lie.
    """
    straight = _straight(mesh)
    _check_corners(mesh, straight)
    parts = [
        _coefficients(mesh.points[mesh.tets[start : start + _CHUNK]]).min(axis=1)
        for start in range(0, len(mesh.tets), _CHUNK)
    ]
    return np.concatenate([np.zeros(0), *parts]) / straight


def straighten_edges(mesh: LumenMesh, least: float = LEAST) -> tuple[LumenMesh, int]:
    """Straighten the edges of elements that may fold; return the mesh, and how many there were.

    Edges of a bad element go half the way to straight, four times, and then the whole.

    Raises
    ------
    FlowError
        As `least_jacobian`.
    """
    points, middle = mesh.points.copy(), _middles(mesh)
    touched: NDArray[np.bool_] = np.zeros(len(mesh.tets), dtype=bool)
    now = mesh
    for turn in range(_HALVINGS + len(EDGES)):
        bad = least_jacobian(now) < least
        if not bad.any():
            break
        touched |= bad
        nodes = np.unique(mesh.tets[bad, 4:])
        points[nodes] = 0.5 * (points[nodes] + middle[nodes]) if turn < _HALVINGS else middle[nodes]
        now = replace(mesh, points=points.copy())
    return now, int(touched.sum())


def _middles(mesh: LumenMesh) -> FloatArray:
    """Return the points with every edge's node at its straight middle."""
    points = mesh.points.copy()
    points[mesh.tets[:, 4:]] = mesh.points[mesh.tets[:, EDGES]].mean(axis=2)
    return points


def _straight(mesh: LumenMesh) -> FloatArray:
    corner = mesh.points[mesh.tets[:, :4]]
    return np.asarray(np.linalg.det(corner[:, 1:] - corner[:, :1]), dtype=np.float64)


def _check_corners(mesh: LumenMesh, straight: FloatArray) -> None:
    bad = np.flatnonzero(~(straight > 0.0))
    if len(bad):
        at = mesh.points[mesh.tets[bad[0], :4]].mean(axis=0)
        raise FlowError(
            f"element {int(bad[0])} of the lumen's mesh is flat or inverted (volume "
            f"{straight[bad[0]] / 6.0:.3g} mm³ near {at[0]:.3f}, {at[1]:.3f}, {at[2]:.3f} mm; "
            f"{len(bad)} such of {len(straight)}); mesh the lumen again, finer there"
        )


def _coefficients(nodes: FloatArray) -> FloatArray:
    """Return the determinant's Bernstein coefficients (t, 20) of elements (t, 10, 3)."""
    corner = nodes[:, :4]
    control = np.empty((len(nodes), 4, 4, 3))
    for i in range(4):
        control[:, i, i] = corner[:, i]
    for edge, (i, j) in enumerate(EDGES):
        between = 2.0 * nodes[:, 4 + edge] - 0.5 * (corner[:, i] + corner[:, j])
        control[:, i, j] = control[:, j, i] = between
    # Derivatives along the edges from corner 0 are linear: a vector at each corner.
    slope = 2.0 * (control[:, :, 1:] - control[:, :, :1])
    first = np.cross(slope[:, :, None, 0], slope[:, None, :, 1])
    triple = np.einsum("tijx,tkx->tijk", first, slope[:, :, 2])
    return np.stack([_gathered(triple, key) for key in _KEYS], axis=1)


def _gathered(triple: FloatArray, key: tuple[int, ...]) -> FloatArray:
    """Sum the products of three linear coefficients that share a Bernstein polynomial."""
    orders = [ijk for ijk in product(range(4), repeat=3) if tuple(sorted(ijk)) == key]
    total = sum(triple[:, i, j, k] for i, j, k in orders)
    weight = np.prod([factorial(key.count(i)) for i in range(4)]) / factorial(3)
    return np.asarray(weight * total, dtype=np.float64)


_KEYS: Final = tuple(combinations_with_replacement(range(4), 3))
