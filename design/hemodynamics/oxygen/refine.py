"""Solve for oxygen on finer and finer grids; return the finest and the next coarser solution."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from design.errors import FlowError
from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.solution import OxygenSolution
from design.hemodynamics.oxygen.solve import SolverOptions, solve_oxygen
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.hemodynamics.zero_d.flow import FlowSolution
from design.network import VesselNetwork

GRIDS: Final = 3
"""Each of twice the next one's spacing."""

Grids = Callable[[float], TissueGrid]
"""A tissue's grid by its spacing in mm."""


def solve_refined(
    network: VesselNetwork,
    flow: FlowSolution,
    grids: Grids,
    spacing_mm: float,
    conditions: OxygenConditions,
    options: SolverOptions | None = None,
    report: Callable[[float, str], None] | None = None,
) -> tuple[OxygenSolution, OxygenSolution | None]:
    """Solve at ``spacing_mm``, by way of four and two times that.

    Returns
    -------
    OxygenSolution, OxygenSolution or None
        At the spacing asked for, and at twice that; None where the tissue is too thin for it.

    Raises
    ------
    FlowError
        As `solve_oxygen`, or for a spacing that the tissue can't be cut by.
    """
    solution: OxygenSolution | None = None
    before: OxygenSolution | None = None
    for number in range(GRIDS):
        spacing = spacing_mm * 2.0 ** (GRIDS - 1 - number)
        if report is not None:
            report(8.0 ** (number - GRIDS), f"{spacing * 1e3:.3g} µm")
        if number < GRIDS - 1:
            solution = _coarse(network, flow, grids, spacing, conditions, solution, options)
            before = solution
    return solve_oxygen(network, flow, grids(spacing_mm), conditions, solution, options), before


def _coarse(
    network: VesselNetwork,
    flow: FlowSolution,
    grids: Grids,
    spacing: float,
    conditions: OxygenConditions,
    guess: OxygenSolution | None,
    options: SolverOptions | None,
) -> OxygenSolution | None:
    """What a coarser grid says; None where it can't resolve what the finest one may."""
    try:
        return solve_oxygen(network, flow, grids(spacing), conditions, guess, options)
    except FlowError:
        return None
