"""Check curved tetrahedra for folding by bounds of the Jacobian; straighten those that fold.

A quadratic tetrahedron's Jacobian determinant is a cubic. Written in Bernstein polynomials, it
lies between the least and greatest of its 20 coefficients everywhere in the element (Johnen,
Remacle & Geuzaine 2013, doi 10.1016/j.jcp.2012.08.051), so that positive coefficients prove it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement, product
from math import factorial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.lumen_mesh import EDGES, LumenMesh
from kernels.arrays import FloatArray

LEAST: Final = 0.05
"""Least Bernstein coefficient, as part of the straight element's determinant, that is let pass."""

_HALVINGS: Final = 4
_CHUNK: Final = 20_000


def least_jacobian(mesh: LumenMesh) -> FloatArray:
    """Lower bound of each element's Jacobian over that of the straight one, (t,); 1 if straight.

    Positive where the element is mapped one to one for certain.

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
    """The mesh with edges drawn towards straight where elements would fold, and how many did.

    Edges of a bad element go half the way to straight, and again, and at last the whole.

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
    """Straight middle of every edge at its node's place; corners as they are."""
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
    """Bernstein coefficients (t, 20) of the determinant of elements (t, 10, 3)."""
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
    """All products of three linear coefficients that share a Bernstein polynomial."""
    orders = [ijk for ijk in product(range(4), repeat=3) if tuple(sorted(ijk)) == key]
    total = sum(triple[:, i, j, k] for i, j, k in orders)
    weight = np.prod([factorial(key.count(i)) for i in range(4)]) / factorial(3)
    return np.asarray(weight * total, dtype=np.float64)


_KEYS: Final = tuple(combinations_with_replacement(range(4), 3))
