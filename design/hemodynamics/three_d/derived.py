"""Nodal samples, wall shear, mean port pressures and power balance of a 3D flow solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.hemodynamics.three_d import lagrange
from design.hemodynamics.three_d.engine import port_name
from design.hemodynamics.three_d.lagrange import gradients
from design.hemodynamics.three_d.meshing.lumen_mesh import WALL, LumenMesh
from design.hemodynamics.three_d.ports import PortPlan
from design.hemodynamics.three_d.solution import Energy, Field, WallShear
from design.hemodynamics.three_d.stokes import Spaces
from kernels.arrays import FloatArray, IntArray


def state_of(spaces: Spaces, unknowns: FloatArray) -> Any:
    """The engine's function of these unknowns."""
    state = spaces.ng.GridFunction(spaces.both)
    state.vec.FV().NumPy()[:] = unknowns
    return state


def field_of(spaces: Spaces, mesh: LumenMesh, unknowns: FloatArray) -> Field:
    """Velocity and pressure at the nodes of every element."""
    velocity, pressure = state_of(spaces, unknowns).components
    return Field(
        mesh,
        sample_function(spaces, mesh, velocity, spaces.order),
        sample_function(spaces, mesh, pressure, spaces.order - 1),
        spaces.order,
    )


def sample_function(spaces: Spaces, mesh: LumenMesh, function: Any, degree: int) -> FloatArray:
    """Values (t, n, c) at the nodes of this degree, in the mesh's own order of corners."""
    ng, at = spaces.ng, lagrange.nodes(degree)
    # The engine's coordinates belong to its corners 0, 1 and 2; corner 3 is the rest.
    rule = ng.IntegrationRule([tuple(p[:3]) for p in at], [0.0] * len(at))
    points = spaces.mesh.MapToAllElements(rule, ng.VOL)
    return np.asarray(function(points)).reshape(len(mesh.tets), len(at), -1)


# Compute wall shear at the wall's mesh nodes from the gradient of a 3D velocity field.
#
# Of what was tried on a pipe (docs/flow.md), the direct gradient of cubic velocities is within 0.1
# % where projections and consistent forces aren't, or cost a solve.

_FACE_EDGES = ((0, 1), (1, 2), (2, 0))


def wall_shear(field: Field, viscosity_pa_s: float) -> WallShear:
    """τ = -μ ∂u/∂n along the wall, n outward: the way the fluid pulls the wall."""
    mesh = field.mesh
    faces = np.flatnonzero(mesh.label == WALL)
    tet, corner = elements_behind(mesh, faces)
    traction = np.zeros((len(faces), 6, 3))
    for corners in np.unique(corner, axis=0):
        mine = np.flatnonzero((corner == corners).all(axis=1))
        node = mesh.points[mesh.tets[tet[mine]]]
        at = _face_nodes(corners)
        slope, map_slope = gradients(field.velocity[tet[mine]], node, field.order, at)
        normal = _normal(map_slope, corners)
        along = -viscosity_pa_s * np.einsum("fqcx,fqx->fqc", slope, normal)
        traction[mine] = along - np.einsum("fqc,fqc->fq", along, normal)[..., None] * normal
    return _averaged(mesh.faces[faces], traction)


def elements_behind(mesh: LumenMesh, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Element of each of these faces (f,), and which of its corners are the face's (f, 3)."""
    sides = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    count = mesh.corner_count
    side_key = _key(mesh.tets[:, sides].reshape(-1, 3), count)
    order = np.argsort(side_key, kind="stable")
    half_faces = order[np.searchsorted(side_key[order], _key(mesh.faces[faces, :3], count))]
    tet = half_faces // 4
    same = mesh.tets[tet, :4][:, None, :] == mesh.faces[faces, :3][:, :, None]
    return tet, same.argmax(axis=2)


def _key(triple: IntArray, count: int) -> IntArray:
    low, mid, high = np.sort(triple, axis=1).T
    return np.asarray((low * count + mid) * count + high, dtype=np.int64)


def _face_nodes(corners: IntArray) -> FloatArray:
    """Barycentric coordinates of a face's six nodes in its element, (6, 4)."""
    at = np.zeros((6, 4))
    for k in range(3):
        at[k, corners[k]] = 1.0
    for k, (i, j) in enumerate(_FACE_EDGES):
        at[3 + k, corners[[i, j]]] = 0.5
    return at


def _normal(map_slope: FloatArray, corners: IntArray) -> FloatArray:
    """Outward unit normal (f, q, 3): the gradient of the opposite corner's coordinate, reversed."""
    opposite = 6 - int(corners.sum())
    inverse = np.linalg.inv(map_slope)
    inward = -inverse.sum(axis=2) if opposite == 0 else inverse[:, :, opposite - 1]
    return np.asarray(-inward / np.linalg.norm(inward, axis=-1, keepdims=True))


def _averaged(faces: IntArray, traction: FloatArray) -> WallShear:
    node, place = np.unique(faces.ravel(), return_inverse=True)
    count = np.bincount(place)
    total = [np.bincount(place, weights=t) for t in traction.reshape(-1, 3).T]
    return WallShear(node, np.stack(total, axis=1) / count[:, None])


# Compute mean port pressures and the power balance of a 3D flow solution.


def port_pressures(room: Spaces, unknowns: FloatArray) -> FloatArray:
    """Mean pressure over each port, (p,), Pa."""
    _, pressure = state_of(room, unknowns).components
    return np.array(
        [
            integrate_over_port(room, k, pressure)
            / integrate_over_port(room, k, room.ng.CoefficientFunction(1.0))
            for k in range(len(room.outward))
        ]
    )


def integrate_over_port(room: Spaces, port: int, function: Any) -> float:
    """Integral over a port."""
    region = room.mesh.Boundaries(port_name(port))
    return float(room.ng.Integrate(function, room.mesh, definedon=region, order=3 * room.order))


def energy_of(room: Spaces, plan: PortPlan, unknowns: FloatArray) -> Energy:
    """Power at the ends against what viscosity takes.

    From u times the momentum equation, ∫ μ ∇u:∇u = -Σ ∫ (p + ½ ϱ u·u) u·n + Σ ∫ μ ∂u/∂n·u. For
    Stokes flow the kinetic part isn't in it, and is as much in as out in a pipe.
    """
    ng = room.ng
    velocity, pressure = state_of(room, unknowns).components
    normal, slope = ng.specialcf.normal(3), ng.Grad(velocity)
    head = pressure + 0.5 * plan.density * velocity * velocity
    traction = plan.viscosity_pa_s * (ng.BoundaryFromVolumeCF(slope) * normal)
    leaving = head * (velocity * normal) - traction * velocity
    ends = -sum(integrate_over_port(room, k, leaving) for k in range(len(room.outward)))
    taken = ng.Integrate(ng.InnerProduct(slope, slope), room.mesh, order=2 * room.order)
    return Energy(float(ends), plan.viscosity_pa_s * float(taken))
