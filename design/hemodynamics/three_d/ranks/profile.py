"""Compute velocities at a port's mesh nodes for a given flow (developed or parabola)."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from design.errors import FlowError
from design.hemodynamics.three_d.lumen_mesh import WALL, LumenMesh
from kernels.arrays import FloatArray, IntArray

Profile = Literal["developed", "parabola"]

# Dunavant 1985 (doi 10.1002/nme.1620210612), degree 5 on the triangle; weights sum up to 1/2.
_A, _B = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
_POINTS: Final = np.array([[1 / 3, 1 / 3], *([[a, a], [1 - 2 * a, a], [a, 1 - 2 * a]][k]
                                             for a in (_A, _B) for k in range(3))])  # fmt: skip
_WEIGHTS: Final = np.array(
    [9 / 80, *[(155 - np.sqrt(15.0)) / 2400] * 3, *[(155 + np.sqrt(15.0)) / 2400] * 3]
)


def port_velocity(mesh: LumenMesh, port: int, flow_ul_s: float, profile: Profile) -> FloatArray:
    """Velocity at a port's nodes that brings ``flow_ul_s`` into the lumen; 0 elsewhere.

    ``developed`` is the steady flow in a straight duct of the port's own shape, -Δw = 1 with
    w = 0 at its rim, by the port's quadratic triangles; in a circle it is the parabola.
    ``parabola`` is 1 - (r/R)² about the port's centre. Both are scaled so that the triangles'
    own integral is the flow.

    Returns
    -------
    (n + e, 3) float64, mm/s

    Raises
    ------
    FlowError
        When the port has no faces, or no node off the wall: the mesh is too coarse there.
    """
    faces, inner = _inner_nodes(mesh, port)
    if profile == "developed":
        shape = _duct(mesh.points, faces, inner)
    else:
        shape = np.zeros(len(mesh.points))
        opening = mesh.ports[port]
        radius = np.linalg.norm(mesh.points[inner] - opening.centre, axis=1)
        shape[inner] = np.maximum(1.0 - (radius / opening.radius_mm) ** 2, 0.0)
    jacobian, values, _ = _at_quadrature(mesh.points, faces)
    through = float(np.einsum("q,fq,qi,fi->", _WEIGHTS, jacobian, values, shape[faces]))
    speed = flow_ul_s / through * shape
    return -speed[:, None] * mesh.ports[port].outward


def _inner_nodes(mesh: LumenMesh, port: int) -> tuple[IntArray, IntArray]:
    faces = mesh.faces[mesh.label == port + 1]
    if len(faces) == 0:
        raise FlowError(f"port {port} has no faces (label {port + 1}); mesh the lumen again")
    inner = np.setdiff1d(faces, mesh.faces[mesh.label == WALL])
    if len(inner) == 0:
        raise FlowError(
            f"port {port} has no node off the wall, so no flow can pass it; mesh it finer"
        )
    return faces, inner


def _duct(points: FloatArray, faces: IntArray, inner: IntArray) -> FloatArray:
    """Solution of -Δw = 1, w = 0 but at ``inner``, per node of ``points``."""
    jacobian, values, gradient = _at_quadrature(points, faces)
    local = np.einsum("q,fq,fqix,fqjx->fij", _WEIGHTS, jacobian, gradient, gradient)
    load = np.einsum("q,fq,qi->fi", _WEIGHTS, jacobian, values)
    slot = np.full(len(points), -1)
    slot[inner] = np.arange(len(inner))
    at = slot[faces]
    row, column = np.repeat(at, 6, axis=1).ravel(), np.tile(at, 6).ravel()
    both = (row >= 0) & (column >= 0)
    size = (len(inner), len(inner))
    matrix = csc_array(coo_array((local.ravel()[both], (row[both], column[both])), shape=size))
    right = np.zeros(len(inner))
    np.add.at(right, at[at >= 0], load[at >= 0])
    velocity = np.zeros(len(points))
    velocity[inner] = splu(matrix).solve(right)
    return velocity


def _at_quadrature(
    points: FloatArray, faces: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Area elements (f, q), shape functions (q, 6), their gradients along the face (f, q, 6, 3)."""
    values, slopes = _shapes(_POINTS)
    tangent = np.einsum("qia,fix->fqax", slopes, points[faces])
    metric = np.einsum("fqax,fqbx->fqab", tangent, tangent)
    gradient = np.einsum("qia,fqab,fqbx->fqix", slopes, np.linalg.inv(metric), tangent)
    return np.sqrt(np.linalg.det(metric)), values, gradient


def _shapes(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Quadratic shape functions (q, 6) and slopes (q, 6, 2), in the order of a mesh's faces."""
    s, t = at.T
    r = 1.0 - s - t
    values = [r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r]
    zero = np.zeros_like(s)
    by_s = [1 - 4 * r, 4 * s - 1, zero, 4 * (r - s), 4 * t, -4 * t]
    by_t = [1 - 4 * r, zero, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)]
    return np.stack(values, 1), np.stack([np.stack(by_s, 1), np.stack(by_t, 1)], 2)
