"""Solve steady 3D flow in a lumen on MPI ranks, by FEniCSx and PETSc.

::

    cd CASE_FOLDER
    mpirun -n 8 python3 -m engine . [options of PETSc]

It imports nothing of printctl: `write_case` copies it as `engine.py` into the case's folder, which
can then be moved to a cluster. It reads `case.json` and the arrays beside it, each rank its share,
and writes `velocity.npy` (a row a node), `pressure.npy` (a value a corner) and `ranks.json`.

Find u (quadratic) and p (linear, both on quadratic tetrahedra), with u given at the wall and at
ports of kind ``profile``, so that for all v and q, v vanishing where u is given,

    ∫ μ ∇u:∇v + ϱ (∇u u)·v - p ∇·v - q ∇·u dx
        + Σ_k p_k ∫_k v·n ds - ½ ϱ Σ_o ∫_o min(u·n, 0) u·v ds = 0,

k the open ports, o those of them that are outlets; the terms with ϱ for ``navier_stokes`` alone.
p_k is given, or the unknown of a group of ports whose flow outward, Q = Σ ∫ u·n ds, obeys
Q - D p = s (a resistance: D = 1/R; a supply: D = 0). The last term keeps backflow from feeding
energy in (Bazilevs et al. 2009, doi 10.1016/j.cma.2009.04.015).

FEniCSx 0.5 to 0.9; `elements`, `rows`, `distributed` and `problem_of` hold what differs.
"""

from __future__ import annotations

import inspect
import json
import logging
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import petsc4py

petsc4py.init([sys.argv[0], *sys.argv[2:]])  # before anything that starts PETSc itself

import dolfinx  # noqa: E402
import numpy as np  # noqa: E402
import ufl  # noqa: E402
from dolfinx import fem  # noqa: E402
from dolfinx import mesh as meshes  # noqa: E402
from dolfinx.fem import petsc as assembly  # noqa: E402
from mpi4py import MPI  # noqa: E402
from petsc4py import PETSc  # noqa: E402

WORLD = MPI.COMM_WORLD
WALL = 0
DEGREE = {"quadrature_degree": 6}  # two quadratic factors and the quadratic map's Jacobian


@dataclass(frozen=True)
class Limits:
    """Limits of the solvers."""

    direct_unknowns: int = 150_000  # above it ``auto`` takes multigrid: a factor needs more memory
    newton_steps: int = 30
    krylov_steps: int = 2000
    krylov_restart: int = 100
    inexact: float = 1e-3  # relative residual of a linear solve whose matrix the next step replaces


LIMITS = Limits()


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
    groups = []
    for group in case["groups"]:
        total = loads[group["ports"][0]].copy()
        for k in group["ports"][1:]:
            total.axpy(1.0, loads[k])
        groups.append(total)
    return RanksProblem(case, space, velocity, pressure, solution, given, np.asarray(at[0]), *forms,
                   faces, loads, groups, np.zeros(len(groups)))  # fmt: skip


def _forms(case: dict[str, Any], space: Any, solution: Any, faces: Any) -> tuple[Any, Any, Any]:
    """Compile the weak form, its derivative, and the pressure's mass by viscosity."""
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
    """Assemble a vector, and add the shares of ranks where they meet."""
    vector = assembly.assemble_vector(form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector


def flows(problem: RanksProblem, loads: list[Any]) -> Any:
    """Out of each port or group, µL/s."""
    values = problem.solution.x.array[: problem.owned]
    return np.array([WORLD.allreduce(float(load.array @ values)) for load in loads])


def residual(problem: RanksProblem) -> tuple[Any, Any]:
    """Return the residuals of the weak form (0 for given velocities) and of the groups' laws."""
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
    """Return a dofmap as an array, a row a cell (an adjacency list before 0.7)."""
    if hasattr(dofmap, "array"):
        count = len(dofmap.offsets) - 1
        return np.asarray(dofmap.array).reshape(count, -1)
    return np.asarray(dofmap)


def share(folder: Path, name: str) -> Any:
    """Read this rank's rows of an array."""
    stored = np.load(folder / name, mmap_mode="r")
    ends = np.linspace(0, len(stored), WORLD.size + 1).astype(np.int64)
    return np.array(stored[ends[WORLD.rank] : ends[WORLD.rank + 1]])


def distributed(folder: Path) -> Any:
    """Read the case's mesh, and divide it by PETSc's partitioner."""
    cells = np.ascontiguousarray(share(folder, "tets.npy")[:, TO_BASIX])
    words = inspect.signature(meshes.create_mesh).parameters
    domain = {"domain" if "domain" in words else "e": ufl.Mesh(elements()[0])}
    return meshes.create_mesh(WORLD, cells=cells, x=share(folder, "points.npy"), **domain)


def tagged(domain: Any, folder: Path, node: Any) -> Any:
    """Label the boundary's facets by their corners in the file."""
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
    """Return the file's node at each point of a Lagrange space on this rank.

    A space of the geometry's own degree numbers a cell's points as the geometry does, one of
    corners alone takes the first four.
    """
    points = rows(space.dofmap.list)
    nodes = np.full(int(points.max()) + 1, -1, dtype=np.int64)
    nodes[points] = node[rows(domain.geometry.dofmap)[:, : points.shape[1]]]
    return nodes


def say(text: str) -> None:
    """Print a line of the log, once."""
    if WORLD.rank == 0:
        print(text, flush=True)


def peak_mb() -> float:
    """Return the most memory that this rank has held, MB."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return float(next(x for x in lines if x.startswith("VmHWM:")).split()[1]) * 1024 / 1e6
    except OSError:  # not Linux
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def solve_case(folder: Path) -> None:
    """Solve, and write `velocity.npy`, `pressure.npy` and, last, `ranks.json`."""
    begun = time.perf_counter()
    case = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    problem = problem_of(folder, case)
    ready = time.perf_counter()
    kind = case["solver"]
    if kind == "auto":
        kind = "direct" if problem.unknowns <= LIMITS.direct_unknowns else "iterative"
    say(
        f"FEniCSx {dolfinx.__version__}, {WORLD.size} ranks, {problem.unknowns:,} unknowns, "
        f"{case['model']}, {kind}; ready after {ready - begun:.1f} s"
    )
    steps = newton(problem, kind, case["tolerance"])
    solved = time.perf_counter()
    ports = port_rows(problem)
    write_field(folder / "velocity.npy", problem, problem.velocity, (case["nodes"], 3))
    write_field(folder / "pressure.npy", problem, problem.pressure, (case["corners"],))
    report = {
        "case": case["id"],
        "dolfinx": dolfinx.__version__,
        "ranks": WORLD.size,
        "unknowns": problem.unknowns,
        "solver": kind,
        "steps": steps,
        "ports": ports,
        "setup_s": ready - begun,
        "solve_s": solved - ready,
        "total_s": time.perf_counter() - begun,
        "memory_mb": WORLD.allgather(peak_mb()),
    }
    if WORLD.rank == 0:
        draft = folder / f".{os.getpid()}.ranks.json"
        draft.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        draft.replace(folder / "ranks.json")
    say(f"done after {time.perf_counter() - begun:.1f} s")


def newton(problem: RanksProblem, kind: str, tolerance: float) -> list[dict[str, Any]]:
    """Solve until the residual is ``tolerance`` of the lift's; a row a step.

    Raises
    ------
    RuntimeError
        When it doesn't get there.
    """
    matrix = assembly.assemble_matrix(problem.jacobian, bcs=[problem.given])
    matrix.assemble()
    linear = problem.case["model"] == "stokes"
    solver = LinearSolver(problem, matrix, kind, 0.3 * tolerance if linear else LIMITS.inexact)
    left, laws = residual(problem)
    first = left.norm(), float(np.abs(laws).max(initial=0.0))
    share = _share(left, laws, first)
    steps: list[dict[str, Any]] = []
    while not share <= tolerance:
        if len(steps) == LIMITS.newton_steps or share != share:
            raise RuntimeError(
                f"residual {share:.2e} after {len(steps)} steps, wanted {tolerance:g}; lower the "
                "flow, or refine the mesh"
            )
        begun, before = time.perf_counter(), solver.iterations
        if steps and not linear:
            matrix.zeroEntries()
            assembly.assemble_matrix(matrix, problem.jacobian, bcs=[problem.given])
            matrix.assemble()
            solver.solver.setOperators(matrix)
        step, pressure = solver.solve(left, laws)
        problem.solution.x.array[: problem.owned] -= step.array
        problem.solution.x.scatter_forward()
        problem.group_pressure[:] -= pressure
        left, laws = residual(problem)
        share, spent = _share(left, laws, first), time.perf_counter() - begun
        iterations = solver.iterations - before
        steps.append({"residual": share, "iterations": iterations, "seconds": spent})
        say(f"step {len(steps)}: residual {share:.2e}, {iterations} iterations, {spent:.1f} s")
    return steps


def _share(left: Any, laws: Any, first: tuple[float, float]) -> float:
    """Return the residual over the first, the larger of forces and of flows."""
    parts = left.norm(), float(np.abs(laws).max(initial=0.0))
    return max(part / (whole or 1.0) for part, whole in zip(parts, first, strict=True))


MULTIGRID = {
    "fieldsplit_u_ksp_type": "preonly",
    "fieldsplit_u_pc_type": "hypre",
    "fieldsplit_u_pc_hypre_boomeramg_strong_threshold": 0.5,
    "fieldsplit_u_pc_hypre_boomeramg_coarsen_type": "HMIS",
    "fieldsplit_u_pc_hypre_boomeramg_interp_type": "ext+i",
    "fieldsplit_u_pc_hypre_boomeramg_P_max": 4,
    "fieldsplit_p_ksp_type": "preonly",
    "fieldsplit_p_pc_type": "jacobi",
}


class LinearSolver:
    """Solves with a problem's Jacobian and its groups of ports, and counts iterations."""

    def __init__(self, problem: RanksProblem, matrix: Any, kind: str, tolerance: float) -> None:
        self.problem, self.matrix, self.iterations = problem, matrix, 0
        self.solver = PETSc.KSP().create(WORLD)
        self.solver.setOperators(matrix)
        if kind == "direct":
            _factorise(self.solver)
        else:
            _precondition(self.solver, problem, tolerance)
        self.solver.setFromOptions()

    def solve(self, right: Any, laws: Any) -> tuple[Any, Any]:
        """Solve K x + B y = right, Bᵀ x - D y = laws, by the Schur complement in the groups.

        A group couples all velocities of its ports, which would fill the matrix.
        """
        solved = self._plain(right)
        groups = [cleared(self.problem, load.copy()) for load in self.problem.groups]
        if not groups:
            return solved, laws
        each = [self._plain(load) for load in groups]
        small = np.array([[load.dot(x) for x in each] for load in groups])
        small += np.diag([law["slope"] for law in self.problem.case["groups"]])
        pressure = np.linalg.solve(small, [load.dot(solved) for load in groups] - laws)
        for amount, x in zip(pressure, each, strict=True):
            solved.axpy(-amount, x)
        return solved, pressure

    def _plain(self, right: Any) -> Any:
        solved = self.matrix.createVecRight()
        self.solver.solve(right, solved)
        reason = self.solver.getConvergedReason()
        if reason < 0:
            raise RuntimeError(
                f"the linear solver stopped after {self.solver.its} iterations (PETSc's reason "
                f"{reason}); take the other of direct and iterative, or more memory"
            )
        self.iterations += self.solver.its
        return solved


def _factorise(solver: Any) -> None:
    solver.setType("preonly")
    inner = solver.getPC()
    inner.setType("lu")
    inner.setFactorSolverType("mumps")
    inner.setFactorSetUpSolverType()
    inner.getFactorMatrix().setMumpsIcntl(14, 80)  # per cent more room, for pivots


def _precondition(solver: Any, problem: RanksProblem, tolerance: float) -> None:
    """Upper block triangle: multigrid for velocity, mass by viscosity for the Schur complement.

    The Laplace form leaves the three velocities uncoupled, which scalar multigrid wants.
    Elman, Silvester, Wathen 2014 (doi 10.1093/acprof:oso/9780199678792.001.0001), chapter 4.
    """
    solver.setType("fgmres")
    solver.setGMRESRestart(LIMITS.krylov_restart)
    solver.setTolerances(rtol=tolerance, max_it=LIMITS.krylov_steps)
    inner = solver.getPC()
    inner.setType("fieldsplit")
    velocity, pressure = (
        _indices(problem, x.unknown) for x in (problem.velocity, problem.pressure)
    )
    inner.setFieldSplitIS(("u", velocity), ("p", pressure))
    inner.setFieldSplitType(PETSc.PC.CompositeType.SCHUR)
    inner.setFieldSplitSchurFactType(PETSc.PC.SchurFactType.UPPER)
    mass = assembly.assemble_matrix(problem.mass)
    mass.assemble()
    stand_in = mass.createSubMatrix(pressure, pressure)
    stand_in.scale(-1.0)
    inner.setFieldSplitSchurPreType(PETSc.PC.SchurPreType.USER, stand_in)
    options = PETSc.Options()
    for key, value in MULTIGRID.items():
        if not options.hasName(key):
            options[key] = value
    if not PETSc.Sys.hasExternalPackage("hypre"):
        options["fieldsplit_u_pc_type"] = "gamg"


def _indices(problem: RanksProblem, unknown: Any) -> Any:
    """Return a field's unknowns of this rank, numbered over all ranks."""
    dofmap = problem.space.dofmap
    start = dofmap.index_map.local_range[0] * dofmap.index_map_bs
    own = np.sort(unknown[unknown < problem.owned]) + start
    return PETSc.IS().createGeneral(own.astype(PETSc.IntType), comm=WORLD)


def port_rows(problem: RanksProblem) -> list[dict[str, Any]]:
    """Return each port's flow outward and mean pressure."""
    pressure = ufl.split(problem.solution)[1]
    one = fem.Constant(problem.space.mesh, PETSc.ScalarType(1.0))
    rows = []
    for port, flow in zip(problem.case["ports"], flows(problem, problem.loads), strict=True):
        over = problem.faces(port["label"])
        push, area = (
            WORLD.allreduce(float(fem.assemble_scalar(fem.form(value * over))))
            for value in (pressure, one)
        )
        rows.append(
            {
                "label": port["label"],
                "flow_out_ul_s": float(flow),
                "pressure_pa": push / area,
                "area_mm2": area,
            }
        )
    return rows


def write_field(path: Path, problem: RanksProblem, field: Field, shape: tuple[int, ...]) -> None:
    """Write a field at the file's nodes, from the first rank."""
    values = problem.solution.x.array[field.unknown].reshape(-1, *shape[1:])
    parts = WORLD.gather((field.node, values))
    if parts is None:
        return
    whole = np.full(shape, np.nan)
    for node, each in parts:
        whole[node] = each
    draft = path.with_name(f".{os.getpid()}.{path.name}")
    np.save(draft, whole)
    draft.replace(path)


if __name__ == "__main__":
    logging.disable(logging.INFO)  # of the compiler, every rank's
    try:
        if np.issubdtype(PETSc.ScalarType, np.complexfloating):
            raise RuntimeError("this PETSc was built for complex numbers; take one for real ones")
        solve_case(Path(sys.argv[1]))
    except BaseException as failure:  # One rank's failure would leave the others waiting.
        message = f"rank {WORLD.rank}: {type(failure).__name__}: {failure}"
        print(message, file=sys.stderr, flush=True)
        WORLD.Abort(1)
