"""`printctl flow` on a network or run folder: solve and write the flow at requested fidelities."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import typer

from printctl.analysis.flow import NPZ, CsvTables, NpzTables
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.exports import EXPORTS, write_exports
from printctl.analysis.networks import load_source
from printctl.cli.flow_match import match
from printctl.cli.flow_options import Match, OtherSolvers
from printctl.cli.flow_output import FlowOutput
from printctl.cli.flow_part import part_of, space_of
from printctl.cli.flow_printed import driven_of, run_as_printed
from printctl.cli.flow_ranks import run_other_solvers
from printctl.cli.flow_solve import in_space, lumped_and_waves
from printctl.errors import UsageError

FILLET: Final = 0.5
"""Of a network that no recipe rounds."""


def run_network(
    context: typer.Context, network: Path, out: Path, others: OtherSolvers, how: Match
) -> FlowOutput:
    """Solve and write what the options in ``context.params`` ask for.

    Parameters
    ----------
    others, how
        Some of these options, as one value each.

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
    source = load_source(network, asked["unit"], None)
    # Options are a recipe's section under the same names: `part_of` takes them by name.
    if network.is_dir():
        driven, fillet, output.summary["conditions"] = driven_of(context, network, "flow of a run")
    else:
        driven = Driven(part_of(asked)[0])
        fillet = FILLET if asked["fillet_ratio"] is None else asked["fillet_ratio"]
    if source.notes:
        output.summary["notes"] = list(source.notes)
    tables = NpzTables(out / NPZ) if asked["results"] == "npz" else CsvTables(out)
    lumped_and_waves(source.network, driven, tables, output)
    output.files = list(tables.files)
    paths = {name: asked[name] for name in EXPORTS if asked[name] is not None}
    space = space_of(asked)
    output.files += write_exports(paths, source.network, driven, space, fillet)
    in_space(source.network, driven, out, fillet, output)
    run_other_solvers(source.network, driven, space, out, fillet, others, output)
    match(source.network, driven, space, out, fillet, how, output)
    return output
