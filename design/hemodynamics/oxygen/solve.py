"""Solve oxygen in vessels and tissue by Newton's method with a preconditioned Krylov solver."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, bicgstab

from design.errors import FlowError
from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.multigrid import (
    VCycle,
    apply,
    bath_conductance,
    coarser,
    finest_level,
    restrict_losses,
)
from design.hemodynamics.oxygen.solution import HALF, OxygenSolution
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.hemodynamics.oxygen.transport import (
    Elements,
    cut_vessels,
    exchange,
    gather,
    lumen_share,
    scatter,
    sweep,
    transport_of,
)
from design.hemodynamics.zero_d.steady import FlowSolution
from design.network import VesselNetwork
from kernels.arrays import FloatArray


class SolverLimits(NamedTuple):
    """When the oxygen solver stops."""

    tolerance: float = 1e-6
    """Sum of the sizes of what is left over in all cells, over what is taken up."""
    newton: int = 40
    """Steps at most."""
    krylov: int = 200
    """Linear steps at most in each of these."""
    grids: int = 3
    """Of `solve_refined`, each of twice the next one's spacing."""


LIMITS: Final = SolverLimits()


def solve_oxygen(
    network: VesselNetwork,
    flow: FlowSolution,
    grid: TissueGrid,
    conditions: OxygenConditions,
    guess: OxygenSolution | None = None,
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
    guess : OxygenSolution, optional
        On another grid of the same tissue, to begin with.

    Raises
    ------
    FlowError
        When nothing flows, no vessel runs through the tissue, lumens fill it, or the steps don't
        lead to a solution.
    """
    if not np.abs(flow.flow).max() > 0.0:
        raise FlowError("no vessel carries any flow, and so no oxygen; check the flow first")
    problem = OxygenProblem(network, flow, grid, conditions)
    _check(problem)
    c = _begin(grid, conditions, guess)
    steps = cycles = 0
    loss = problem.loss(c)
    while float(np.abs(loss).sum()) > (goal := LIMITS.tolerance * _scale(problem, c)):
        if steps == LIMITS.newton:
            raise FlowError(
                f"oxygen: {steps} Newton steps leave {np.abs(loss).sum():.3g} nmol/s unbalanced, "
                f"above {goal:.3g}; raise half_millimolar ({conditions.half_millimolar:g} mM) or "
                "lower the spacing"
            )
        slope = problem.slope(c)
        inverse = problem.approximate_inverse(slope)
        size = float(np.abs(loss).sum())
        aim = min(0.03, max(0.3 * goal / size, 1e-10))
        c += _solve_linear(partial(problem.change, slope=slope), -loss, inverse, aim)
        loss = problem.loss(c)
        steps, cycles = steps + 1, cycles + inverse.count
    return _solution(problem, c, steps, cycles)


def _solve_linear(
    change: Callable[[FloatArray], FloatArray],
    given: FloatArray,
    inverse: VCycle,
    tolerance: float,
) -> FloatArray:
    """Return about the solution of ``change(x) = given``, (n,); Newton's method judges it."""
    shape = 2 * given.shape
    exact = LinearOperator(shape, change, dtype=np.float64)
    about = LinearOperator(shape, inverse, dtype=np.float64)
    return bicgstab(exact, given, rtol=tolerance, atol=0.0, maxiter=LIMITS.krylov, M=about)[0]


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
            "tissue are in one frame and in the same units"
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


class OxygenProblem:
    """Diffusion and uptake in cells, coupled to vessels; all fields are flat, (cells,).

    A cell loses Σ D h (c - c') + g (c - c_bath) + φ V M c/(K + c) - (flux from vessels). Below 0,
    where only an iterate can be, uptake goes on with its slope there, M/K: the loss stays concave
    and smooth, and Newton's steps climb to the solution from below.
    """

    def __init__(
        self,
        network: VesselNetwork,
        flow: FlowSolution,
        grid: TissueGrid,
        conditions: OxygenConditions,
    ) -> None:
        self.grid, self.conditions = grid, conditions
        self.elements: Elements = cut_vessels(network, grid)
        self.transport = transport_of(network, flow, self.elements)
        one = self.elements
        bound = np.add.reduceat(one.weight, one.start[:-1]) > 0.0
        self.conductance = np.where(
            bound, exchange(one.radius, one.length, grid.spacing_mm, conditions), 0.0
        )
        self.share = np.where(grid.inside, 1.0 - lumen_share(network, grid), 0.0)
        self.uptake = (self.share * grid.cell_ul * conditions.uptake_millimolar_s).ravel()
        self.levels = coarser(finest_level(grid, conditions.tissue_diffusivity_mm2_s))
        self.bath = np.zeros(grid.inside.size)
        if conditions.bath_millimolar is not None:
            self.bath = bath_conductance(grid, conditions.tissue_diffusivity_mm2_s).ravel()
        self._lumped = np.zeros(grid.inside.size)
        scatter(self.elements, self.conductance, self._lumped)

    def around(self, c: FloatArray) -> FloatArray:
        """What the grid holds at each element, (n,), mM."""
        return gather(self.elements, c)

    def taken_up(self, c: FloatArray) -> FloatArray:
        """By each cell, nmol/s."""
        half = self.conditions.half_millimolar
        return self.uptake * c / (half + np.maximum(c, 0.0))

    def loss(self, c: FloatArray) -> FloatArray:
        """What each cell loses and isn't given, nmol/s; 0 for the solution."""
        bath = self.conditions.bath_millimolar or 0.0
        flux = sweep(
            self.transport, self.conductance, self.around(c), self.conditions.inlet_millimolar
        )[0]
        loss = self._spread(c, self.bath) + self.taken_up(c) - self.bath * bath
        scatter(self.elements, -flux, loss)
        return loss

    def _spread(self, c: FloatArray, own: FloatArray) -> FloatArray:
        shape = self.grid.inside.shape
        spread = np.zeros(shape)
        apply(self.levels[0]._replace(own=own.reshape(shape)), c.reshape(shape), spread)
        return spread.ravel()

    def slope(self, c: FloatArray) -> FloatArray:
        """Loss per concentration by uptake and bath, of each cell, µL/s."""
        half = self.conditions.half_millimolar
        return self.uptake * half / (half + np.maximum(c, 0.0)) ** 2 + self.bath

    def change(self, step: FloatArray, slope: FloatArray) -> FloatArray:
        """By how much `loss` changes with a small step, exactly: what is upstream included."""
        flux = sweep(self.transport, self.conductance, self.around(step), 0.0)[0]
        change = self._spread(step, slope)
        scatter(self.elements, -flux, change)
        return change

    def approximate_inverse(self, slope: FloatArray) -> VCycle:
        """Of `change`, with each vessel's exchange counted at the cells themselves."""
        self.levels[0].own.ravel()[:] = slope + self._lumped
        restrict_losses(self.levels)
        return VCycle(self.levels)


Grids = Callable[[float], TissueGrid]
"""A tissue's grid by its spacing in mm."""


def solve_refined(
    network: VesselNetwork,
    flow: FlowSolution,
    grids: Grids,
    spacing_mm: float,
    conditions: OxygenConditions,
    report: Callable[[float, str], None] | None = None,
) -> tuple[OxygenSolution, OxygenSolution | None]:
    """Solve at ``spacing_mm``, by way of four and two times that.

    Returns
    -------
    OxygenSolution, OxygenSolution or None
        At ``spacing_mm``, and at twice that; None where the tissue is too thin for it.

    Raises
    ------
    FlowError
        As `solve_oxygen`, or for a spacing that the tissue can't be cut by.
    """
    solution: OxygenSolution | None = None
    for number in range(LIMITS.grids):
        spacing = spacing_mm * 2.0 ** (LIMITS.grids - 1 - number)
        if report is not None:
            report(8.0 ** (number - LIMITS.grids), f"{spacing * 1e3:.3g} µm")
        if number < LIMITS.grids - 1:
            try:
                solution = solve_oxygen(network, flow, grids(spacing), conditions, solution)
            except FlowError:
                # A coarse grid needn't resolve what the finest one may.
                solution = None
    return solve_oxygen(network, flow, grids(spacing_mm), conditions, solution), solution
