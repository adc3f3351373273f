"""Solve the linear system of each Newton step on MPI ranks: MUMPS, or Krylov with multigrid."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx.fem import petsc as assembly
from petsc4py import PETSc

from .problem import RanksProblem, cleared
from .world import WORLD

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
