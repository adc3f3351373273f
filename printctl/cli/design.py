"""`printctl design`: make network, flow table and solid files of a recipe, without printing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import JsonFlag, RecipeArg, messages, print_json, print_lines, print_note
from printctl.pipeline.run import design_recipe
from printctl.recipe import load_recipe


def design(
    recipe: RecipeArg,
    out: Annotated[Path, typer.Option("--out", help="Folder for the files.", show_default=False)],
    as_json: JsonFlag = False,
) -> None:
    """Design only: network.csv, network.vtp, lumen.stl, solid.stl, solid.3mf and flow.csv.

    Nothing is sliced or printed. Files that are there are replaced, each by a whole new one.
    """
    loaded = load_recipe(recipe, print_note)
    have_kernels("design")
    data = design_recipe(loaded, recipe.resolve().parent, out, messages())
    if as_json:
        print_json(data)
        return
    network, flow = data["network"], data["flow"]
    print_lines(
        f"{network['vessels']} vessels, {network['diameter_min_mm']:.3g} to "
        f"{network['diameter_max_mm']:.3g} mm, {network['volume_mm3']:.3g} mm³",
        f"pressure drop {flow['pressure_drop_mmhg']:.3g} mmHg at "
        f"{flow['inlet_flow_ml_min']:.3g} mL/min",
        str(out),
    )
