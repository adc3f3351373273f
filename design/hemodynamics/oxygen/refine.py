"""Solve on coarser grids first: each begins the next, and the last two tell the grid's error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

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
) -> tuple[OxygenSolution, OxygenSolution]:
    """Solve at ``spacing_mm``, by way of four and two times that.

    Returns
    -------
    OxygenSolution, OxygenSolution
        At the spacing asked for, and at twice that.

    Raises
    ------
    FlowError
        As `solve_oxygen`, or for a spacing that the tissue can't be cut by.
    """
    found: list[OxygenSolution] = []
    for number in range(GRIDS):
        spacing = spacing_mm * 2.0 ** (GRIDS - 1 - number)
        if report is not None:
            report(8.0 ** (number - GRIDS), f"{spacing * 1e3:.3g} µm")
        guess = found[-1] if found else None
        found = found[-1:]
        found.append(solve_oxygen(network, flow, grids(spacing), conditions, guess, options))
    return found[-1], found[-2]
