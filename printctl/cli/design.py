"""`printctl design`: make network, flow table and solid files of a recipe, without printing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import (
    JsonFlag,
    RecipeArg,
    folder_to_write,
    messages,
    print_json,
    print_lines,
    print_note,
)
from printctl.errors import UsageError
from printctl.pipeline.run import design_recipe
from printctl.pipeline.run_options import DESIGN_NAMES, names_until
from printctl.recipe import load_recipe

UntilOption = Annotated[
    str | None,
    typer.Option(
        "--until",
        metavar="STAGE",
        help=f"Last stage: {', '.join(DESIGN_NAMES[:-1])} or {DESIGN_NAMES[-1]} (default).",
    ),
]


def design(
    recipe: RecipeArg,
    out: Annotated[
        Path,
        typer.Option(
            "--out", callback=folder_to_write, help="Folder for the files.", show_default=False
        ),
    ],
    until: UntilOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Design only: network.csv, network.vtp, lumen.stl, solid.stl, solid.3mf and flow.csv.

    Nothing is sliced or printed. Files that are there are replaced, each by a whole new one. With
    --until the stages after that one aren't run; a later design goes on from there.
    """
    last = _last_stage(until)
    loaded = load_recipe(recipe, print_note)
    have_kernels("design")
    data = design_recipe(loaded, recipe.resolve().parent, out, messages(), last)
    if as_json:
        print_json(data)
    else:
        print_lines(*_made(data), *([f"done as far as {last}"] if until else []), str(out))


def _last_stage(until: str | None) -> str:
    """Name of the last stage that is run.

    Raises
    ------
    UsageError
        For a stage that isn't known, or comes after design.
    """
    name = DESIGN_NAMES[-1] if until is None else names_until(until)[-1]
    if name not in DESIGN_NAMES:
        raise UsageError(
            f"--until {until}: printctl design ends at {DESIGN_NAMES[-1]}; give one of "
            f"{', '.join(DESIGN_NAMES)}, or use printctl run --until {until}"
        )
    return name


def _made(data: dict[str, Any]) -> list[str]:
    """Say what the stages that were run have made."""
    lines = []
    if "network" in data:
        network = data["network"]
        lines.append(
            f"{network['vessels']} vessels, {network['diameter_min_mm']:.3g} to "
            f"{network['diameter_max_mm']:.3g} mm, {network['volume_mm3']:.3g} mm³"
        )
    if "flow" in data:
        flow = data["flow"]
        lines.append(
            f"pressure drop {flow['pressure_drop_mmhg']:.3g} mmHg at "
            f"{flow['inlet_flow_ml_min']:.3g} mL/min"
        )
    return lines
