"""Lumen mesh of quadratic tetrahedra, and Lagrange elements on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from kernels.arrays import FloatArray, IntArray

WALL = 0
"""Label of the wall's faces; port k has label k + 1."""

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""Corners of a tetrahedron's edges, in VTK's order of the nodes on their middles."""


@dataclass(frozen=True)
class MeshPort:
    """A flat opening of a lumen.

    Attributes
    ----------
    node : int
        Of the network; -1 where the lumen has none.
    centre : (3,) float64, mm
    outward : (3,) float64
        Unit normal, out of the lumen.
    radius_mm : float, mm
        Of the circle of its area.
    inlet : bool
        Flow comes in there, as designed.
    """

    node: int
    centre: FloatArray
    outward: FloatArray
    radius_mm: float
    inlet: bool


@dataclass(frozen=True)
class LumenMesh:
    """Quadratic tetrahedra that fill a lumen, its wall and its ports.

    Attributes
    ----------
    points : (n + e, 3) float64, mm
        Corners first, then a node for each edge: its middle, or where the wall is curved what
        makes the edge follow it.
    tets : (t, 10) int64
        Corners, then edges in the order of `EDGES` (VTK's quadratic tetrahedron). Positively
        oriented: (p1 - p0) x (p2 - p0) . (p3 - p0) > 0.
    corner_count : int
        n.
    faces : (f, 6) int64
        Boundary triangles: corners, outward by the right hand, then the nodes on the edges
        between the first and second, second and third, third and first.
    label : (f,) int64
        `WALL`, or k + 1 for port k.
    ports : tuple of MeshPort
    """

    points: FloatArray
    tets: IntArray
    corner_count: int
    faces: IntArray
    label: IntArray
    ports: tuple[MeshPort, ...]


@cache
def multi_indices(degree: int) -> IntArray:
    """Return all α of four non-negative integers whose sum is ``degree``, (n, 4).

    Nodes of degree k have barycentric coordinates α/k with |α| = k. The polynomial that is 1 at one
    and 0 at the others is Π over the four corners c of Π over j < α_c of (k λ_c - j)/(j + 1),
    Silvester 1969, doi 10.1002/nme.1620010111.
    """
    return np.array(
        [a for a in product(range(degree, -1, -1), repeat=4) if sum(a) == degree], dtype=np.int64
    )


def nodes(degree: int) -> FloatArray:
    """Return the nodes' barycentric coordinates, (n, 4)."""
    return np.asarray(multi_indices(degree) / degree, dtype=np.float64)


def shapes(degree: int, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Evaluate shape functions (q, n) and derivatives (q, n, 4) at barycentric ``at`` (q, 4)."""
    value, slope = _powers(degree, at)
    index = multi_indices(degree)
    factors = np.stack([value[:, c, index[:, c]] for c in range(4)], axis=-1)
    slopes = np.stack([slope[:, c, index[:, c]] for c in range(4)], axis=-1)
    derivatives = np.empty_like(factors)
    for c in range(4):
        others = [d for d in range(4) if d != c]
        derivatives[..., c] = slopes[..., c] * factors[..., others].prod(axis=-1)
    return factors.prod(axis=-1), derivatives


def _powers(degree: int, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the factor of one corner for each α_c, (q, 4, degree + 1), and its derivative."""
    value = np.ones((*at.shape, degree + 1))
    slope = np.zeros_like(value)
    for j in range(degree):
        step = (degree * at - j) / (j + 1)
        slope[..., j + 1] = slope[..., j] * step + value[..., j] * degree / (j + 1)
        value[..., j + 1] = value[..., j] * step
    return value, slope


def quadratic(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Evaluate a curved tetrahedron's map (q, 10) and derivatives (q, 10, 4) at ``at`` (q, 4)."""
    first, second = EDGES.T
    value = np.concatenate([at * (2.0 * at - 1.0), 4.0 * at[:, first] * at[:, second]], axis=1)
    slope = np.zeros((len(at), 10, 4))
    for c in range(4):
        slope[:, c, c] = 4.0 * at[:, c] - 1.0
    for edge, (i, j) in enumerate(EDGES):
        slope[:, 4 + edge, i] = 4.0 * at[:, j]
        slope[:, 4 + edge, j] = 4.0 * at[:, i]
    return value, slope


@cache
def tetrahedron_rule(points: int) -> tuple[FloatArray, FloatArray]:
    """Return barycentric points (n³, 4) and weights (n³,) of sum 1/6, exact to degree 2n - 3.

    Gauss's rule on a cube, collapsed (Duffy 1982, doi 10.1137/0719090).
    """
    x, w = np.polynomial.legendre.leggauss(points)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    a, b, c = (g.ravel() for g in np.meshgrid(x, x, x, indexing="ij"))
    weight = np.einsum("i,j,k->ijk", w, w, w).ravel() * (1.0 - a) ** 2 * (1.0 - b)
    first, second, third = a, (1.0 - a) * b, (1.0 - a) * (1.0 - b) * c
    return np.stack([first, second, third, 1.0 - first - second - third], axis=1), weight


@cache
def triangle_rule() -> tuple[FloatArray, FloatArray]:
    """Return barycentric points (6, 3) and weights (6,) of sum 1, exact to degree 4.

    Dunavant 1985, doi 10.1002/nme.1620210612; the numbers in closed form.
    """
    root, inner = np.sqrt(10.0), np.sqrt(38.0 - 44.0 * np.sqrt(0.4))
    share = np.sqrt(213125.0 - 53320.0 * root)
    points, weights = [], []
    for sign in (1.0, -1.0):
        a = (8.0 - root + sign * inner) / 18.0
        points += [(1.0 - 2.0 * a, a, a), (a, 1.0 - 2.0 * a, a), (a, a, 1.0 - 2.0 * a)]
        weights += [(620.0 + sign * share) / 3720.0] * 3
    return np.array(points), np.array(weights)


def jacobian(node: FloatArray, slope: FloatArray) -> FloatArray:
    """Return dx/dξ (t, q, 3, 3) of elements (t, 10, 3); ξ: coordinates of corners 1, 2 and 3."""
    by_corner = slope[:, :, 1:] - slope[:, :, :1]
    return np.asarray(np.einsum("tnx,qna->tqxa", node, by_corner, optimize=True))


def gradients(
    values: FloatArray, node: FloatArray, degree: int, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient (t, q, c, 3) of fields (t, n, c) and the Jacobian, at ``at`` (q, 4)."""
    _, by_node = shapes(degree, at)
    map_slope = jacobian(node, quadratic(at)[1])
    by_corner = by_node[:, :, 1:] - by_node[:, :, :1]
    by_xi = np.einsum("tnc,qna->tqca", values, by_corner, optimize=True)
    return np.asarray(by_xi @ np.linalg.inv(map_slope)), map_slope
