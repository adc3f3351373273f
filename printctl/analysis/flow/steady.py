"""Solve a network's steady 0D flow as a recipe asks; write a table row per vessel."""

from __future__ import annotations

from typing import Any, Final

from design.hemodynamics import (
    FlowConditions,
    FlowSolution,
    ShearBand,
    band_summary,
    flow_summary,
    flow_table,
    question_pressure,
    solve_flow,
)
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA
from printctl.analysis.flow.tables import FlowTables
from printctl.recipe.parts import FlowPart

TABLE: Final = "flow.csv"


def shear_band(part: FlowPart) -> ShearBand | None:
    """The band of wall shear that the section asks for."""
    band = part.shear_band_dyn_cm2
    return None if band is None else ShearBand(*(value / DYN_CM2_PER_PA for value in band))


def solve_steady(
    tables: FlowTables, network: VesselNetwork, conditions: FlowConditions, part: FlowPart
) -> tuple[FlowSolution, dict[str, Any]]:
    """Solve, write `TABLE`, and return the solution and its summary.

    Raises
    ------
    FlowError
        As `solve_flow`, or for an absurd pressure.
    OSError
        When the file can't be written.
    """
    solution = solve_flow(network, conditions)
    summary: dict[str, Any] = flow_summary(network, solution, conditions)
    question_pressure(summary["pressure_drop_pa"])
    band = shear_band(part)
    if band is not None:
        summary["shear_band"] = band_summary(network, solution, band)
    tables.put(TABLE, flow_table(network, solution, conditions.density, band))
    return solution, summary
