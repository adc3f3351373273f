"""`printctl flow` of a network: its solvers, results and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import typer

from design.hemodynamics.three_d.engine import load_engine
from printctl.analysis.flow import NPZ, CsvTables, NpzTables
from printctl.analysis.flow.conditions import Driven, driven_by_run, recipe_of
from printctl.analysis.flow.exports import EXPORTS, export_notes, write_exports
from printctl.analysis.flow.network_flow import FlowOutput, NetworkFlow
from printctl.analysis.flow.printed.printed_case import PrintedCase, solve_as_printed
from printctl.analysis.flow.typed_over import conditions_said
from printctl.analysis.networks import load_source
from printctl.cli.design.flow_options import OtherSolvers, part_of, space_of
from printctl.cli.options import messages
from printctl.errors import UsageError

FILLET: Final = 0.5
"""Of a network that no recipe rounds."""


def run_network(
    context: typer.Context, network: Path, out: Path, others: OtherSolvers
) -> FlowOutput:
    """Solve and write what the options in ``context.params`` ask for; some are ``others``.

    Raises `UsageError` for options that don't go together, and what the solvers raise.
    """
    requested, output = context.params, FlowOutput()
    if requested["as_printed"]:
        _as_printed(context, network, out, output)
        return output
    if requested["scanned"]:
        raise UsageError("--scanned is for --as-printed --three-d; add these, or leave it out")
    source = load_source(network, requested["unit"], None)
    # Options are a recipe's section under the same names: `part_of` takes them by name.
    if network.is_dir():
        driven, fillet, output.summary["conditions"] = driven_of(context, network, "flow of a run")
    else:
        driven = Driven(part_of(requested)[0])
        fillet = FILLET if requested["fillet_ratio"] is None else requested["fillet_ratio"]
    if driven.part.three_d is not None:
        load_engine()  # Missing, it is better told before 0D is solved.
    tables = NpzTables(out / NPZ) if requested["results"] == "npz" else CsvTables(out)
    space = space_of(requested)
    with messages().status("0D flow") as status:
        made = NetworkFlow(source.network, driven, space, out, fillet, status.update, output)
        made.lumped_and_waves(tables)
        if source.notes:
            output.summary["notes"] = [*source.notes, *output.summary.get("notes", ())]
        output.files = list(tables.files)
        paths = {name: requested[name] for name in EXPORTS if requested[name] is not None}
        files, reported = write_exports(paths, source.network, driven, space, fillet)
        output.files += files
        output.summary |= reported
        if notes := export_notes(reported):
            output.summary["notes"] = [*output.summary.get("notes", ()), *notes]
        made.in_space()
        if others.ranks is not None:
            made.on_ranks(others.ranks, others.ranks_python)
    return output


_ELSEWHERE: Final = "svzerod", "svoned", "ranks", "svmultiphysics", "compare", "check", "results"


def _as_printed(context: typer.Context, folder: Path, out: Path, output: FlowOutput) -> None:
    """Solve by the recipe's conditions and what was typed in their place."""
    requested = context.params
    for key in _ELSEWHERE:
        if requested[key] not in (None, False):
            raise UsageError(f"--{key} doesn't go with --as-printed; leave one of them out")
    if requested["unit"] not in (None, "mm"):
        raise UsageError(f"a run folder's files are in mm, not {requested['unit']}; drop --unit")
    if requested["scanned"] and not requested["three_d"]:
        raise UsageError("--scanned is for --three-d; add that, or leave it out")
    driven, fillet, stated = driven_of(context, folder, "--as-printed")
    case = PrintedCase(folder, driven, fillet, requested["scanned"])
    with messages().status("flow as printed") as status:
        summary, files = solve_as_printed(case, out, status.update)
    output.summary |= {"conditions": stated} | summary
    output.files += files


def driven_of(context: typer.Context, folder: Path, what: str) -> tuple[Driven, float, str]:
    """A run's conditions with what was typed in their place, its fillets, a sentence on it."""
    requested, recipe = context.params, recipe_of(folder, what)
    part, typed = part_of(requested, recipe.flow, recipe.print_scale)
    ratio = requested["fillet_ratio"]
    fillet = recipe.solid.fillet_ratio if ratio is None else ratio
    driven = driven_by_run(folder, part, recipe.print_scale)
    return driven, fillet, conditions_said(part, typed, recipe.print_scale)
