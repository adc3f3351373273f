"""Solve 1D pulse waves along vessels; write a row per vessel and waves at the network's ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from design.hemodynamics import (
    OneDOptions,
    PulsatileConditions,
    one_d_summary,
    one_d_table,
    one_d_waves,
    question_pressure,
    solve_one_d,
)
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from printctl.analysis.flow.tables import FlowTables
from printctl.recipe.parts import OneDPart

ONE_D, ONE_D_WAVES = "flow_1d.csv", "flow_1d_waves.csv"


def one_d_options(part: OneDPart, samples: int) -> OneDOptions:
    """A recipe's words as options."""
    return OneDOptions(
        cell_mm=part.cell_mm,
        wall_viscosity_pa_s=part.wall_viscosity_pa_s,
        profile_exponent=part.profile_exponent,
        most_cycles=part.most_cycles,
        samples=samples,
    )


def solve_and_write_one_d(
    tables: FlowTables,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    options: OneDOptions,
    progress: Callable[[int, float], None] | None = None,
) -> dict[str, Any]:
    """Find the periodic state, write `ONE_D` and `ONE_D_WAVES`, return the summary.

    Raises
    ------
    FlowError
        As `solve_one_d`, or for an absurd pressure.
    OSError
        When a file can't be written.
    """
    solution = solve_one_d(network, conditions, options, progress)
    summary = one_d_summary(network, solution, conditions)
    question_pressure(summary["pressure_max_mmhg"] * PA_PER_MMHG)
    tables.put(ONE_D, one_d_table(network, solution, conditions))
    tables.put(ONE_D_WAVES, one_d_waves(network, solution, conditions))
    return summary
