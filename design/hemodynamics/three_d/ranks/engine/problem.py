"""Set up a case's 3D flow equations on MPI ranks: spaces, weak forms, boundary values."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as meshes
from dolfinx.fem import petsc as assembly
from mpi4py import MPI
from petsc4py import PETSc

WALL = 0
DEGREE = {"quadrature_degree": 6}  # two quadratic factors and the quadratic map's Jacobian


@dataclass(frozen=True)
class Field:
    """Velocity or pressure: its unknowns on this rank, and the file's node of each point."""

    unknown: Any
    node: Any


@dataclass(frozen=True)
class RanksProblem:
    """Forms, unknowns, what is given; loads of a unit pressure at each port and each group.

    `group_pressure`, an array that is changed in place, holds the groups' unknowns.
    """

    case: dict[str, Any]
    space: Any
    velocity: Field
    pressure: Field
    solution: Any
    given: Any
    given_unknown: Any
    residual: Any
    jacobian: Any
    mass: Any
    faces: Any
    loads: list[Any]
    groups: list[Any]
    group_pressure: Any

    @property
    def owned(self) -> int:
        """Unknowns of this rank."""
        dofmap = self.space.dofmap
        return int(dofmap.index_map.size_local * dofmap.index_map_bs)

    @property
    def unknowns(self) -> int:
        """Unknowns of all ranks."""
        return int(self.space.dofmap.index_map.size_global * self.space.dofmap.index_map_bs)


def problem_of(folder: Path, case: dict[str, Any]) -> RanksProblem:
    """Read a case and set its forms up."""
    domain = distributed(folder)
    node = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    make = getattr(fem, "functionspace", None) or fem.FunctionSpace
    space = make(domain, elements()[1])
    (flow, at_flow), (push, at_push) = (space.sub(k).collapse() for k in (0, 1))
    velocity = Field(np.asarray(at_flow), node_of(flow, domain, node))
    pressure = Field(np.asarray(at_push), node_of(push, domain, node))
    tags = tagged(domain, folder, node)
    value = fem.Function(flow)
    inflow = np.load(folder / "inflow.npy", mmap_mode="r")
    value.x.array[:] = inflow[velocity.node].ravel()
    driven = [port["label"] for port in case["ports"] if port["kind"] == "profile"]
    facets = tags.indices[np.isin(tags.values, [WALL, *driven])]
    at = fem.locate_dofs_topological((space.sub(0), flow), 2, facets)
    solution = fem.Function(space)
    solution.x.array[np.asarray(at[0])] = value.x.array[np.asarray(at[1])]
    faces = ufl.Measure("ds", domain=domain, subdomain_data=tags)(metadata=DEGREE)
    test, normal = ufl.TestFunctions(space)[0], ufl.FacetNormal(domain)
    loads = [summed(fem.form(ufl.dot(test, normal) * faces(x["label"]))) for x in case["ports"]]
    given = fem.dirichletbc(value, at, space.sub(0))
    forms = _forms(case, space, solution, faces)
    groups = [together([loads[k] for k in group["ports"]]) for group in case["groups"]]
    return RanksProblem(case, space, velocity, pressure, solution, given, np.asarray(at[0]), *forms,
                   faces, loads, groups, np.zeros(len(groups)))  # fmt: skip


def together(vectors: list[Any]) -> Any:
    """Their sum, a new vector."""
    total = vectors[0].copy()
    for vector in vectors[1:]:
        total.axpy(1.0, vector)
    return total


def _forms(case: dict[str, Any], space: Any, solution: Any, faces: Any) -> tuple[Any, Any, Any]:
    """What the weak form leaves, its derivative, and the pressure's mass by viscosity."""
    volume = ufl.dx(metadata=DEGREE)
    u, p = ufl.split(solution)
    v, q = ufl.TestFunctions(space)
    viscosity, density = (
        fem.Constant(space.mesh, PETSc.ScalarType(case[key]))
        for key in ("viscosity_pa_s", "density")
    )
    left = viscosity * ufl.inner(ufl.grad(u), ufl.grad(v)) - p * ufl.div(v) - q * ufl.div(u)
    left += 0.0 * p * q  # a place in the matrix for the pressure's diagonal
    whole = left * volume
    if case["model"] == "navier_stokes":
        whole += density * ufl.dot(ufl.dot(ufl.grad(u), u), v) * volume
        out = ufl.dot(u, ufl.FacetNormal(space.mesh))
        back = -0.5 * density * ufl.conditional(ufl.lt(out, 0.0), out, 0.0) * ufl.dot(u, v)
        for port in case["ports"]:
            if port["outlet"] and port["kind"] == "open":
                whole += back * faces(port["label"])
    mass = ufl.TrialFunctions(space)[1] * q / viscosity * volume
    return fem.form(whole), fem.form(ufl.derivative(whole, solution)), fem.form(mass)


def summed(form: Any) -> Any:
    """A vector, its shares added up where ranks meet."""
    vector = assembly.assemble_vector(form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector


def flows(problem: RanksProblem, loads: list[Any]) -> Any:
    """Out of each port or group, µL/s."""
    values = problem.solution.x.array[: problem.owned]
    return np.array([WORLD.allreduce(float(load.array @ values)) for load in loads])


def residual(problem: RanksProblem) -> tuple[Any, Any]:
    """What the weak form leaves, 0 where a velocity is given; and what the groups' laws leave."""
    left = summed(problem.residual)
    for port, load in zip(problem.case["ports"], problem.loads, strict=True):
        left.axpy(port["pressure_pa"], load)
    for pressure, load in zip(problem.group_pressure, problem.groups, strict=True):
        left.axpy(pressure, load)
    laws = problem.case["groups"]
    slope, given = (np.array([law[key] for law in laws]) for key in ("slope", "given"))
    laws_left = flows(problem, problem.groups) - slope * problem.group_pressure - given
    return cleared(problem, left), laws_left


def cleared(problem: RanksProblem, vector: Any) -> Any:
    """``vector`` with 0 where a velocity is given."""
    own = problem.given_unknown[problem.given_unknown < problem.owned]
    vector.array[own] = 0.0
    return vector


# Read a case's mesh, divide it among MPI ranks, label its boundary; define finite elements.

# VTK's order of a tetrahedron's ten nodes to basix's: corners, then edges 23, 13, 12, 03, 02, 01.
TO_BASIX = [0, 1, 2, 3, 9, 8, 5, 7, 6, 4]


def elements() -> tuple[Any, Any]:
    """Quadratic geometry, and Taylor and Hood's pair, in the words of this version of FEniCSx."""
    cell = "tetrahedron"
    try:
        from basix.ufl import element, mixed_element  # from 0.7
    except ImportError:
        curved = ufl.VectorElement("Lagrange", cell, 2)
        return curved, ufl.MixedElement(curved, ufl.FiniteElement("Lagrange", cell, 1))
    curved = element("Lagrange", cell, 2, shape=(3,))
    return curved, mixed_element([curved, element("Lagrange", cell, 1)])


def rows(dofmap: Any) -> Any:
    """A dofmap as an array, a row a cell (it is an adjacency list before 0.7)."""
    if hasattr(dofmap, "array"):
        count = len(dofmap.offsets) - 1
        return np.asarray(dofmap.array).reshape(count, -1)
    return np.asarray(dofmap)


def share(folder: Path, name: str) -> Any:
    """Rows of an array that this rank reads."""
    stored = np.load(folder / name, mmap_mode="r")
    ends = np.linspace(0, len(stored), WORLD.size + 1).astype(np.int64)
    return np.array(stored[ends[WORLD.rank] : ends[WORLD.rank + 1]])


def distributed(folder: Path) -> Any:
    """The case's mesh, divided by PETSc's partitioner."""
    cells = np.ascontiguousarray(share(folder, "tets.npy")[:, TO_BASIX])
    words = inspect.signature(meshes.create_mesh).parameters
    domain = {"domain" if "domain" in words else "e": ufl.Mesh(elements()[0])}
    return meshes.create_mesh(WORLD, cells=cells, x=share(folder, "points.npy"), **domain)


def tagged(domain: Any, folder: Path, node: Any) -> Any:
    """Labels of the boundary's facets, found by the corners that they have in the file."""
    faces, label = np.load(folder / "faces.npy")[:, :3], np.load(folder / "label.npy")
    topology = domain.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    facets = np.sort(np.asarray(meshes.exterior_facet_indices(topology), dtype=np.int32))
    to_cell = topology.connectivity(2, 3)
    cell = to_cell.array[to_cell.offsets[facets]]
    # Facet i of a cell lies across from its corner i.
    across = rows(topology.connectivity(3, 2))[cell] == facets[:, None]
    corners = node[rows(domain.geometry.dofmap)[cell, :4]][~across].reshape(-1, 3)
    both = np.concatenate([np.sort(faces, axis=1), np.sort(corners, axis=1)])
    _, which = np.unique(both, axis=0, return_inverse=True)
    mark = np.full(int(which.max()) + 1, -1, dtype=np.int32)
    mark[which[: len(faces)]] = label
    marks = mark[which[len(faces) :]]
    if (marks < 0).any():
        raise ValueError("a face of the boundary isn't in faces.npy; write the case again")
    return meshes.meshtags(domain, 2, facets, marks)


def node_of(space: Any, domain: Any, node: Any) -> Any:
    """The file's node at each point of a Lagrange space on this rank.

    A space of the geometry's own degree numbers a cell's points as the geometry does, one of
    corners alone takes the first four.
    """
    points = rows(space.dofmap.list)
    nodes = np.full(int(points.max()) + 1, -1, dtype=np.int64)
    nodes[points] = node[rows(domain.geometry.dofmap)[:, : points.shape[1]]]
    return nodes


WORLD = MPI.COMM_WORLD


def say(text: str) -> None:
    """Print a line of the log, once."""
    if WORLD.rank == 0:
        print(text, flush=True)


def peak_mb() -> float:
    """Most memory that this rank has held, MB."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return float(next(x for x in lines if x.startswith("VmHWM:")).split()[1]) * 1024 / 1e6
    except OSError:  # not Linux
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
