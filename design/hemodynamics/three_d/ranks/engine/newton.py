"""Solve the MPI flow problem by Newton's method; return a log row for each Newton step."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from dolfinx.fem import petsc as assembly

from .linear import LinearSolver
from .problem import RanksProblem, residual
from .world import say

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
