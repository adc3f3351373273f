"""Run `printctl flow` in 3D on MPI ranks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from design.hemodynamics.three_d import straighten_edges
from design.hemodynamics.three_d.ranks import rank_conditions, write_case
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.printed_fidelities import mesh_of
from printctl.analysis.flow.ranks import run_on_ranks
from printctl.cli.flow_options import OtherSolvers
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages
from printctl.recipe.parts import ThreeDPart

CASE = "ranks"


def run_other_solvers(
    network: VesselNetwork,
    driven: Driven,
    space: ThreeDPart,
    out: Path,
    fillet_ratio: float,
    asked: OtherSolvers,
    output: FlowOutput,
) -> None:
    """Do what is asked for; nothing where nothing is.

    Raises
    ------
    FlowError, SolidError, UsageError, PrintctlError, OSError
        As `lumen_mesh`, `run_on_ranks` and the writers.
    """
    if asked.ranks is None:
        return
    mesh = straighten_edges(mesh_of(network, space, fillet_ratio))[0]
    folder = out / CASE
    model: Any = "navier_stokes" if space.inertia else "stokes"
    write_case(mesh, rank_conditions(mesh, driven.steady(network), model=model), folder)
    output.files.append(folder)
    output.summary["ranks"] = _solved(folder, asked.ranks, asked.ranks_python)


def _solved(folder: Path, ranks: int, python: Path | None) -> dict[str, Any]:
    with messages().status(f"3D flow on {ranks} ranks") as status:
        result = run_on_ranks(folder, ranks, python, status.update)
    return {
        "ranks": ranks,
        "pressure_drop_mmhg": float(np.ptp(result.port_pressure)) / PA_PER_MMHG,
    }
