"""Solve steady, pulsatile and 1D flow as a recipe's flow section asks; write the tables of each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from design.hemodynamics import FlowConditions, FlowSolution
from design.network import VesselNetwork
from printctl.analysis.flow.backflow import pulse_notes, steady_notes
from printctl.analysis.flow.conditions import pulsatile_conditions, steady_conditions
from printctl.analysis.flow.one_d import one_d_options, solve_and_write_one_d
from printctl.analysis.flow.outputs import solve_and_write
from printctl.analysis.flow.steady import solve_steady
from printctl.analysis.flow.tables import FlowTables
from printctl.recipe.parts import FlowPart

Cycle = Callable[[int, float, float], None]
"""Takes a 1D cycle's number, its change over the swing, and the change that counts as periodic."""


def solve_section(
    tables: FlowTables,
    network: VesselNetwork,
    part: FlowPart,
    cycle: Cycle,
    *,
    steady: FlowConditions | None = None,
    folder: Path = Path(),
    print_scale: float = 1.0,
) -> tuple[FlowSolution, dict[str, Any]]:
    """Return the steady solution, and the summary of all that was solved, with notes if any.

    Parameters
    ----------
    steady : FlowConditions, optional
        In place of the section's own, at the design's size.
    folder : Path
        The section's tables are relative to it.
    print_scale : float
        See `pulsatile_conditions`.

    Raises
    ------
    FlowError, UsageError, OSError
        As `steady_conditions`, `pulsatile_conditions` and the solvers.
    """
    driven = steady or steady_conditions(part, folder, network)
    solution, summary = solve_steady(tables, network, driven, part)
    notes = steady_notes(network, solution, driven)
    if part.pulse is None:
        return solution, summary | _said(notes)
    steps = part.pulse.steps
    conditions = pulsatile_conditions(part, part.pulse, folder, print_scale, network)
    summary["pulsatile"], waves = solve_and_write(tables, network, conditions, steps)
    notes += pulse_notes(waves)
    if part.one_d is not None:
        options = one_d_options(part.one_d, steps)
        summary["one_d"] = solve_and_write_one_d(
            tables,
            network,
            conditions,
            options,
            lambda number, change: cycle(number, change, options.tolerance),
        )
    return solution, summary | _said(notes)


def _said(notes: list[str]) -> dict[str, list[str]]:
    return {"notes": notes} if notes else {}
