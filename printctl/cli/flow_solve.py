"""What `printctl flow` solves and writes, a function a fidelity."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from design.hemodynamics import (
    FlowConditions,
    flow_summary,
    question_pressure,
    solve_flow,
    write_flow_csv,
)
from design.hemodynamics.zero_d.svzerod import write_svzerod
from design.network import VesselNetwork
from design.units import UL_S_PER_ML_MIN
from printctl.flow import PULSES, WAVES, pulsatile_conditions, solve_and_write
from printctl.pipeline.stages.flow import TABLE
from printctl.recipe.parts import FlowPart


@dataclass
class Found:
    """What is said at the end: numbers, those of other fidelities in dicts, and files."""

    summary: dict[str, Any] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)


def steady(network: VesselNetwork, part: FlowPart, out: Path, found: Found) -> None:
    """Solve the steady flow and write its table.

    Raises
    ------
    FlowError
        As `solve_flow`, or for an absurd pressure.
    OSError
        When a file can't be written.
    """
    conditions = FlowConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet_flow_ul_s=part.inlet_flow_ml_min * UL_S_PER_ML_MIN,
    )
    solution = solve_flow(network, conditions)
    summary = flow_summary(network, solution, conditions)
    question_pressure(summary["pressure_drop_pa"])
    out.mkdir(parents=True, exist_ok=True)
    write_flow_csv(out / TABLE, network, solution)
    found.summary |= summary
    found.files.append(out / TABLE)


def pulsatile(
    network: VesselNetwork, part: FlowPart, out: Path, svzerod: Path | None, found: Found
) -> None:
    """Solve for the periodic state where the section asks for a pulse, and write its tables.

    Raises
    ------
    FlowError, UsageError, OSError
        As `pulsatile_conditions`, `solve_and_write` and `write_svzerod`.
    """
    if part.pulse is None:
        return
    conditions = pulsatile_conditions(part, part.pulse, Path())
    found.summary["pulsatile"] = solve_and_write(out, network, conditions, part.pulse.steps)
    found.files += [out / PULSES, out / WAVES]
    if svzerod is not None:
        write_svzerod(svzerod, network, conditions, part.pulse.steps)
        found.files.append(svzerod)
