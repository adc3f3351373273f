"""Solve a 3D flow case on MPI ranks, from reading its files to writing its result."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as assembly
from petsc4py import PETSc

from .problem import WORLD, Field, RanksProblem, cleared, flows, peak_mb, problem_of, residual, say

DIRECT_UNKNOWNS = 150_000
"""From where ``auto`` takes multigrid: a factor's memory grows faster than the unknowns."""


def solve_case(folder: Path) -> None:
    """Solve, and write `velocity.npy`, `pressure.npy` and, last, `ranks.json`."""
    begun = time.perf_counter()
    case = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    problem = problem_of(folder, case)
    ready = time.perf_counter()
    kind = case["solver"]
    if kind == "auto":
        kind = "direct" if problem.unknowns <= DIRECT_UNKNOWNS else "iterative"
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
    write_report(folder / "ranks.json", report)
    say(f"done after {time.perf_counter() - begun:.1f} s")


# Solve the MPI flow problem by Newton's method; return a log row for each Newton step.

MOST_STEPS = 30
INEXACT = 1e-3  # of a linear solve whose matrix the next step replaces


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
    solver = LinearSolver(problem, matrix, kind, 0.3 * tolerance if linear else INEXACT)
    left, laws = residual(problem)
    first = left.norm(), float(np.abs(laws).max(initial=0.0))
    share = _share(left, laws, first)
    steps: list[dict[str, Any]] = []
    while not share <= tolerance:
        if len(steps) == MOST_STEPS or share != share:
            raise RuntimeError(
                f"residual {share:.2e} after {len(steps)} steps, wanted {tolerance:g}; lower the "
                "flow, or refine the mesh"
            )
        begun, before = time.perf_counter(), solver.iterations
        if steps and not linear:
            matrix.zeroEntries()
            assembly.assemble_matrix(matrix, problem.jacobian, bcs=[problem.given])
            matrix.assemble()
            solver.renewed()
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
    """The residual by the first; forces and flows have no unit in common, so the larger."""
    parts = left.norm(), float(np.abs(laws).max(initial=0.0))
    return max(part / (whole or 1.0) for part, whole in zip(parts, first, strict=True))


# Solve the linear system of each Newton step on MPI ranks: MUMPS, or Krylov with multigrid.

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

    def renewed(self) -> None:
        """Take note that the matrix has new values."""
        self.solver.setOperators(self.matrix)

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
    solver.setGMRESRestart(100)
    solver.setTolerances(rtol=tolerance, max_it=2000)
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
    """A field's unknowns of this rank, numbered over all ranks."""
    dofmap = problem.space.dofmap
    start = dofmap.index_map.local_range[0] * dofmap.index_map_bs
    own = np.sort(unknown[unknown < problem.owned]) + start
    return PETSc.IS().createGeneral(own.astype(PETSc.IntType), comm=WORLD)


# Gather velocity, pressure and port flows from the MPI ranks and write them to files.


def port_rows(problem: RanksProblem) -> list[dict[str, Any]]:
    """Flow out of each port and mean pressure over it."""
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


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write the report, from the first rank."""
    if WORLD.rank == 0:
        draft = path.with_name(f".{os.getpid()}.{path.name}")
        draft.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        draft.replace(path)
