"""`printctl flow` on a network or run folder: solve and write the flow at requested fidelities."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import typer

from printctl.cli.flow_match import Match, match
from printctl.cli.flow_output import FlowOutput
from printctl.cli.flow_part import part_of
from printctl.cli.flow_printed import run_as_printed
from printctl.cli.flow_ranks import ExternalSolvers, run_external_solvers
from printctl.cli.flow_solve import pulsatile, space, steady, waves
from printctl.errors import UsageError
from printctl.flow import NPZ, CsvTables, NpzTables
from printctl.networks import Drive, load_source

FILLET: Final = 0.5
"""Of a network that no recipe rounds."""


def run_network(context: typer.Context, network: Path, out: Path) -> FlowOutput:
    """Solve and write what the options in ``context.params`` ask for.

    Raises
    ------
    UsageError
        For options that don't go together.
    FlowError, SolidError, OSError
        As the solvers.
    """
    asked, output = context.params, FlowOutput()
    if asked["as_printed"]:
        run_as_printed(context, network, out, output)
        return output
    if asked["scanned"]:
        raise UsageError("--scanned is for --as-printed --three-d; add these, or leave it out")
    # Options are a recipe's section under the same names: `part_of` takes them by name.
    part = part_of(asked)
    fillet = FILLET if asked["fillet_ratio"] is None else asked["fillet_ratio"]
    drive = Drive(part.inlet_flow_ml_min, part.viscosity_mpa_s)
    source = load_source(network, asked["unit"], drive)
    tables = NpzTables(out / NPZ) if asked["results"] == "npz" else CsvTables(out)
    steady(source.network, part, tables, output)
    pulsatile(source.network, part, tables, asked["svzerod"], output)
    waves(source.network, part, tables, asked["svoned"], output)
    output.files = [*tables.files, *output.files]
    space(source.network, part, out, fillet, output)
    others = (
        asked[key] for key in ("ranks", "ranks_python", "slurm", "slurm_set", "svmultiphysics")
    )
    run_external_solvers(source.network, part, ExternalSolvers(out, fillet, *others), output)
    how = Match(*(asked[key] for key in ("match_split", "want", "match_percent", "least_lumen_mm")))
    match(source.network, part, out, fillet, how, output)
    return output
