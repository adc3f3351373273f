"""`printctl flow RUN --as-printed`: solve the flow in a run's designed and printed lumens."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import typer

from printctl.analysis.flow.conditions import Driven, driven_by_run, recipe_of
from printctl.analysis.flow.printed_case import PrintedCase, solve_as_printed
from printctl.cli.flow_output import FlowOutput
from printctl.cli.flow_part import conditions_said, part_of
from printctl.cli.options import messages
from printctl.errors import UsageError

_ELSEWHERE: Final = (
    "svzerod",
    "svoned",
    "ranks",
    "svmultiphysics",
    "compare",
    "check",
    "results",
)


def run_as_printed(context: typer.Context, folder: Path, out: Path, output: FlowOutput) -> None:
    """Solve and write, by the recipe's conditions and what was typed in their place.

    Raises
    ------
    UsageError
        For a network that is no run folder, options that don't go with --as-printed, and as
        `solve_as_printed`.
    FlowError, SolidError, OSError
        As `solve_as_printed`.
    """
    asked = context.params
    for key in _ELSEWHERE:
        if asked[key] not in (None, False):
            name = key.replace("_", "-")
            raise UsageError(f"--{name} doesn't go with --as-printed; leave one of them out")
    if asked["unit"] not in (None, "mm"):
        raise UsageError(f"a run folder's files are in mm, not {asked['unit']}; drop --unit")
    if asked["scanned"] and not asked["three_d"]:
        raise UsageError("--scanned is for --three-d; add that, or leave it out")
    driven, fillet, said = driven_of(context, folder, "--as-printed")
    case = PrintedCase(folder, driven, fillet, asked["scanned"])
    with messages().status("flow as printed") as status:
        summary, files = solve_as_printed(case, out, status.update)
    output.summary |= {"conditions": said} | summary
    output.files += files


def driven_of(context: typer.Context, folder: Path, what: str) -> tuple[Driven, float, str]:
    """A run's conditions with what was typed in their place, its fillets, and the sentence on it.

    Raises
    ------
    UsageError
        As `recipe_of`, `part_of` and `driven_by_run`.
    """
    asked, recipe = context.params, recipe_of(folder, what)
    part, typed = part_of(asked, recipe.flow, recipe.print_scale)
    ratio = asked["fillet_ratio"]
    fillet = recipe.solid.fillet_ratio if ratio is None else ratio
    driven = driven_by_run(folder, part, recipe.print_scale)
    return driven, fillet, conditions_said(part, typed, recipe.print_scale)
