"""Newton's method from the lift of what is given, each step told."""

from __future__ import annotations

import time
from typing import Any

from dolfinx.fem import petsc as assembly

from .linear import LinearSolver
from .problem import Problem, residual
from .world import say

MOST_STEPS = 30
INEXACT = 1e-5  # of a linear solve whose matrix the next step replaces


def newton(problem: Problem, kind: str, tolerance: float) -> list[dict[str, Any]]:
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
    left = residual(problem)
    first = left.norm() or 1.0
    share = left.norm() / first
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
        problem.solution.x.array[: problem.owned] -= solver.solve(left).array
        problem.solution.x.scatter_forward()
        left = residual(problem)
        share, spent = left.norm() / first, time.perf_counter() - begun
        iterations = solver.iterations - before
        steps.append({"residual": share, "iterations": iterations, "seconds": spent})
        say(f"step {len(steps)}: residual {share:.2e}, {iterations} iterations, {spent:.1f} s")
    return steps
