"""3D flow solutions: fields, wall shear, pressures and power at ports; VTK files (`.vtu`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.files import write_text
from design.geometry.vtk import vtk_document
from design.hemodynamics.three_d.engine import port_name
from design.hemodynamics.three_d.meshing.lumen_mesh import (
    EDGES,
    WALL,
    LumenMesh,
    gradients,
    nodes,
    shapes,
)
from design.hemodynamics.three_d.newton import Spaces
from design.hemodynamics.three_d.ports import PortPlan
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Field:
    """Velocity and pressure at one time, element by element.

    Attributes
    ----------
    mesh : LumenMesh
    velocity : (t, n, 3) float64, mm/s
        At the nodes of degree k of every element, in the order of `lumen_mesh.nodes`.
    pressure : (t, n', 1) float64, Pa
        At those of degree k - 1.
    order : int
        k.
    """

    mesh: LumenMesh
    velocity: FloatArray
    pressure: FloatArray
    order: int


@dataclass(frozen=True)
class WallShear:
    """Viscous force of the fluid on the wall, by area.

    Attributes
    ----------
    node : (w,) int64
        Of the mesh, on the wall.
    traction : (w, 3) float64, Pa
        Along the wall, the mean of the faces that meet at the node.
    """

    node: IntArray
    traction: FloatArray

    @property
    def magnitude(self) -> FloatArray:
        """Return the size of the traction, (w,), Pa."""
        return np.asarray(np.linalg.norm(self.traction, axis=1), dtype=np.float64)


@dataclass(frozen=True)
class Energy:
    """Power in at the ports and dissipated; a Pa·µL/s is a nW.

    Attributes
    ----------
    ends_nw : float, nW
        Pressure, kinetic energy and viscous traction of what flows in, less those of what leaves.
    viscous_nw : float, nW
        μ ∫ ∇u:∇u.
    """

    ends_nw: float
    viscous_nw: float

    @property
    def imbalance(self) -> float:
        """Return their difference over the larger."""
        largest = max(abs(self.ends_nw), abs(self.viscous_nw))
        return abs(self.ends_nw - self.viscous_nw) / largest if largest else 0.0


@dataclass(frozen=True)
class ThreeDSolution:
    """Steady flow in a lumen.

    Attributes
    ----------
    field : Field
    wall_shear : WallShear
    port_flow : (p,) float64, µL/s
        Out of the lumen by each port of the mesh.
    port_pressure : (p,) float64, Pa
        Mean over the port.
    reynolds : (p,) float64
        By mean speed and the diameter of the port's circle of the same area.
    energy : Energy
    unknowns : int
        Of velocity and pressure, given ones included.
    residual : (k,) float64
        After each of Newton's steps, of that of no flow.
    krylov : int
        Linear steps taken.
    coefficients : (unknowns,) float64
        NGSolve's own, which `residence_time` takes.
    """

    field: Field
    wall_shear: WallShear
    port_flow: FloatArray
    port_pressure: FloatArray
    reynolds: FloatArray
    energy: Energy
    unknowns: int
    residual: FloatArray
    krylov: int
    coefficients: FloatArray

    @property
    def mass_imbalance(self) -> float:
        """Return what leaves less what comes in, over what comes in."""
        into = -float(self.port_flow[self.port_flow < 0.0].sum())
        return abs(float(self.port_flow.sum())) / into if into else 0.0


@dataclass(frozen=True)
class ThreeDWaves:
    """A cycle of pulsatile flow in its periodic state.

    Attributes
    ----------
    time_s : (t,) float64, s
        From 0, the cycle's end left out.
    port_flow : (p, t) float64, µL/s
        Out of the lumen.
    port_pressure : (p, t) float64, Pa
    section_flow, section_pressure : (s, t) float64
        At the requested sections.
    change : (c,) float64
        From each cycle's begin to its end, relative.
    """

    time_s: FloatArray
    port_flow: FloatArray
    port_pressure: FloatArray
    section_flow: FloatArray
    section_pressure: FloatArray
    change: FloatArray


def state_of(spaces: Spaces, unknowns: FloatArray) -> Any:
    """Return NGSolve's function of these unknowns."""
    state = spaces.ng.GridFunction(spaces.both)
    state.vec.FV().NumPy()[:] = unknowns
    return state


def field_of(spaces: Spaces, mesh: LumenMesh, unknowns: FloatArray) -> Field:
    """Sample velocity and pressure at the nodes of every element."""
    velocity, pressure = state_of(spaces, unknowns).components
    return Field(
        mesh,
        sample_function(spaces, mesh, velocity, spaces.order),
        sample_function(spaces, mesh, pressure, spaces.order - 1),
        spaces.order,
    )


def sample_function(spaces: Spaces, mesh: LumenMesh, function: Any, degree: int) -> FloatArray:
    """Sample a function (t, n, c) at the nodes of this degree, in the mesh's order of corners."""
    ng, at = spaces.ng, nodes(degree)
    # The engine's coordinates belong to its corners 0, 1 and 2; corner 3 is the rest.
    rule = ng.IntegrationRule([tuple(p[:3]) for p in at], [0.0] * len(at))
    points = spaces.mesh.MapToAllElements(rule, ng.VOL)
    return np.asarray(function(points)).reshape(len(mesh.tets), len(at), -1)


def wall_shear(field: Field, viscosity_pa_s: float) -> WallShear:
    """Compute τ = -μ ∂u/∂n along the wall, n outward: the way the fluid pulls the wall."""
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


def shear_of_faces(solution: ThreeDSolution) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return middle (f, 3), mm, and area (f,), mm², of the wall's triangles; shear at nodes, Pa.

    The shear (f, 6) is that of the three corners and of the three edges' middles.
    """
    mesh, shear = solution.field.mesh, solution.wall_shear
    faces = mesh.faces[mesh.label == WALL]
    corners = mesh.points[faces[:, :3]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    return corners.mean(axis=1), area, shear.magnitude[np.searchsorted(shear.node, faces)]


def face_mean(shear: FloatArray) -> FloatArray:
    """Return the mean of a quadratic over triangles: that of its values amid the edges."""
    return np.asarray(shear[:, 3:].mean(axis=1), dtype=np.float64)


def elements_behind(mesh: LumenMesh, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return the element of each of these faces (f,), and its corners on the face (f, 3).

    Raises
    ------
    FlowError
        A face that bounds no element.
    """
    sides = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    count = mesh.corner_count
    side_key = _key(mesh.tets[:, sides].reshape(-1, 3), count)
    order = np.argsort(side_key, kind="stable")
    key = _key(mesh.faces[faces, :3], count)
    sides_of = order[np.searchsorted(side_key[order], key).clip(max=len(order) - 1)]
    if (side_key[sides_of] != key).any():
        face = int(faces[np.argmax(side_key[sides_of] != key)])
        raise FlowError(f"face {face} bounds no tetrahedron; mesh again")
    tet = sides_of // 4
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
        at[3 + k, corners[[k, (k + 1) % 3]]] = 0.5
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


def port_pressures(room: Spaces, unknowns: FloatArray) -> FloatArray:
    """Return the mean pressure over each port, (p,), Pa."""
    _, pressure = state_of(room, unknowns).components
    return np.array(
        [
            integrate_over_port(room, k, pressure)
            / integrate_over_port(room, k, room.ng.CoefficientFunction(1.0))
            for k in range(len(room.outward))
        ]
    )


def integrate_over_port(room: Spaces, port: int, function: Any) -> float:
    """Integrate a function over a port."""
    region = room.mesh.Boundaries(port_name(port))
    return float(room.ng.Integrate(function, room.mesh, definedon=region, order=3 * room.order))


def energy_of(room: Spaces, plan: PortPlan, unknowns: FloatArray) -> Energy:
    """Compute the power that comes in at the ends and what viscosity dissipates.

    From u times the momentum equation, ∫ μ ∇u:∇u = -Σ ∫ (p + ½ ϱ u·u) u·n + Σ ∫ μ ∂u/∂n·u.
    Stokes flow has no kinetic part; in a pipe as much of it comes in as leaves.
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


_QUADRATIC_TETRAHEDRON: Final = 24
"""VTK's number of the cell."""


def write_flow_vtu(
    path: Path,
    field: Field,
    wall_shear: WallShear | None = None,
    more: Mapping[str, FloatArray] | None = None,
) -> None:
    """Write velocity, pressure, wall shear (0 inside) and more at the mesh's nodes, as VTU.

    Cubic velocities are given at the corners and edges' middles alone.

    Parameters
    ----------
    path : Path
    field : Field
    wall_shear : WallShear, optional
    more : mapping of name to (points,) or (points, 3) float64, optional
        Such as `at_points` of an age; units in the name.

    Raises
    ------
    FlowError
        An array of another length.
    OSError
        When the file can't be written.
    """
    mesh = field.mesh
    data = {
        "velocity_mm_s": at_points(mesh, field.velocity, field.order),
        "pressure_pa": at_points(mesh, field.pressure, field.order - 1)[:, 0],
        **(more or {}),
    }
    if wall_shear is not None:
        traction = np.zeros((len(mesh.points), 3))
        traction[wall_shear.node] = wall_shear.traction
        data |= {"wall_shear_pa": traction}
    for name, values in data.items():
        if len(values) != len(mesh.points):
            raise FlowError(
                f"{name}: {len(values)} values for {len(mesh.points)} nodes; give one each"
            )
    cells = len(mesh.tets)
    sections: dict[str, Mapping[str, NDArray[Any]]] = {
        "PointData": data,
        "Points": {"Points": mesh.points},
        "Cells": {
            "connectivity": mesh.tets.ravel(),
            "offsets": 10 * np.arange(1, cells + 1),
            "types": np.full(cells, _QUADRATIC_TETRAHEDRON, dtype=np.uint8),
        },
    }
    counts = {"NumberOfPoints": len(mesh.points), "NumberOfCells": cells}
    write_text(path, vtk_document("UnstructuredGrid", counts, sections))


def at_points(mesh: LumenMesh, values: FloatArray, degree: int) -> FloatArray:
    """Evaluate values (t, n, c) at elements' nodes of a degree at the mesh's own points, (p, c)."""
    own = np.concatenate([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])
    by_node = shapes(degree, own)[0]
    at_elements = np.einsum("pn,tnc->tpc", by_node, values)
    at_nodes = np.zeros((len(mesh.points), values.shape[2]))
    at_nodes[mesh.tets] = at_elements
    return at_nodes
