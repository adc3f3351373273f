"""Solve oxygen in vessels and tissue by Newton's method with a preconditioned Krylov solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse.linalg import LinearOperator, bicgstab

from design.errors import FlowError
from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.multigrid import VCycle
from design.hemodynamics.oxygen.problem import OxygenProblem
from design.hemodynamics.oxygen.solution import HALF, OxygenSolution
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.hemodynamics.oxygen.transport import sweep
from design.hemodynamics.zero_d.flow import FlowSolution
from design.network import VesselNetwork
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class SolverOptions:
    """Convergence limits of the oxygen solver.

    Attributes
    ----------
    tolerance : float
        Sum of the sizes of what is left over in all cells, over what is taken up.
    newton, krylov : int
        Steps at most.
    """

    tolerance: float = 1e-6
    newton: int = 40
    krylov: int = 200


def solve_oxygen(
    network: VesselNetwork,
    flow: FlowSolution,
    grid: TissueGrid,
    conditions: OxygenConditions,
    guess: OxygenSolution | None = None,
    options: SolverOptions | None = None,
) -> OxygenSolution:
    """Solve steady advection in the vessels, diffusion and uptake in the tissue.

    Vessels and tissue are solved as one: Newton's linear systems hold how a cell acts through the
    stream on all that lies downstream.

    Parameters
    ----------
    network : VesselNetwork
        In the tissue's frame.
    flow : FlowSolution
        Of that network, in any direction.
    grid : TissueGrid
    conditions : OxygenConditions
    guess : OxygenSolution, optional
        On another grid of the same tissue, to begin with.
    options : SolverOptions, optional

    Raises
    ------
    FlowError
        When nothing flows, no vessel runs through the tissue, lumens fill it, or the steps don't
        lead to a solution.
    """
    options = options or SolverOptions()
    if not np.abs(flow.flow).max() > 0.0:
        raise FlowError("no vessel carries any flow, and so no oxygen; check the flow first")
    problem = OxygenProblem(network, flow, grid, conditions)
    _check(problem)
    c = _begin(grid, conditions, guess)
    steps = cycles = 0
    loss = problem.loss(c)
    while float(np.abs(loss).sum()) > (goal := options.tolerance * _scale(problem, c)):
        if steps == options.newton:
            raise FlowError(
                f"oxygen: {steps} Newton steps leave {np.abs(loss).sum():.3g} nmol/s unbalanced, "
                f"above {goal:.3g}; raise half_millimolar ({conditions.half_millimolar:g} mM) or "
                "lower the spacing"
            )
        slope = problem.slope(c)
        inverse = problem.approximate_inverse(slope)
        size = float(np.abs(loss).sum())
        aim = min(0.03, max(0.3 * goal / size, 1e-10))
        change = partial(problem.change, slope=slope)
        step = _solve_linear(change, -loss, inverse, aim, options.krylov)
        c += step
        loss = problem.loss(c)
        steps, cycles = steps + 1, cycles + inverse.count
    return _solution(problem, c, steps, cycles)


def _solve_linear(
    change: Callable[[FloatArray], FloatArray],
    given: FloatArray,
    inverse: VCycle,
    tolerance: float,
    max_steps: int,
) -> FloatArray:
    """Return about the solution of ``change(x) = given``, (n,); Newton's method judges it."""
    shape = 2 * given.shape
    exact = LinearOperator(shape, change, dtype=np.float64)
    about = LinearOperator(shape, inverse, dtype=np.float64)
    return bicgstab(exact, given, rtol=tolerance, atol=0.0, maxiter=max_steps, M=about)[0]


def _check(problem: OxygenProblem) -> None:
    """Raise where there is nothing to solve for."""
    if not problem.share.max() >= HALF:
        raise FlowError(
            f"no cell of {problem.grid.spacing_mm * 1e3:g} µm is tissue by half: lumens fill it; "
            "lower the spacing"
        )
    if not problem.conductance.any() and problem.conditions.bath_millimolar is None:
        raise FlowError(
            "no vessel runs through the tissue, so nothing reaches it; check that network and "
            "tissue are in one frame and in the units said"
        )


def _scale(problem: OxygenProblem, c: FloatArray) -> float:
    """What is taken up, nmol/s; a millionth of what could be where that is next to nothing."""
    return float(max(problem.taken_up(c).sum(), 1e-6 * problem.uptake.sum()))


def _begin(
    grid: TissueGrid, conditions: OxygenConditions, guess: OxygenSolution | None
) -> FloatArray:
    if guess is None:
        return np.where(grid.inside, 0.5 * conditions.inlet_millimolar, 0.0).ravel()
    coarse = guess.grid
    index = [
        np.clip(
            np.floor((grid.origin_mm[k] + grid.spacing_mm * np.arange(n) - coarse.origin_mm[k])
                     / coarse.spacing_mm + 0.5).astype(np.int64), 1, m - 2)
        for k, (n, m) in enumerate(zip(grid.inside.shape, coarse.inside.shape, strict=True))
    ]  # fmt: skip
    return np.where(grid.inside, guess.concentration[np.ix_(*index)], 0.0).ravel()


def _solution(problem: OxygenProblem, c: FloatArray, steps: int, cycles: int) -> OxygenSolution:
    conditions, transport = problem.conditions, problem.transport
    flux, entry, leaves = sweep(
        transport, problem.conductance, problem.around(c), conditions.inlet_millimolar
    )
    count = len(transport.flow)
    brought = np.where(np.isfinite(leaves), transport.flow * leaves, 0.0)
    taken = np.where(np.isfinite(entry), transport.flow * entry, 0.0)
    nodes = len(transport.supplied)
    at_nodes = np.bincount(transport.end, weights=brought, minlength=nodes)
    at_nodes -= np.bincount(transport.begin, weights=taken, minlength=nodes)
    supplied = float(transport.supplied.sum()) * conditions.inlet_millimolar
    bath = conditions.bath_millimolar or 0.0
    return OxygenSolution(
        conditions=conditions,
        grid=problem.grid,
        concentration=c.reshape(problem.grid.inside.shape),
        tissue_share=problem.share,
        entry=entry,
        exit=leaves,
        wall_flux=np.asarray(
            np.bincount(problem.elements.vessel, weights=flux, minlength=count), dtype=np.float64
        ),
        supplied=supplied,
        # What nodes pass on balances; what they don't pass on has left the network.
        drained=float(at_nodes.sum()) + supplied,
        from_bath=float((problem.bath * (bath - c)).sum()),
        consumed=float(problem.taken_up(c).sum()),
        flow_ul_s=float(transport.supplied.sum()),
        newton=steps,
        cycles=cycles,
    )
