"""`printctl toolpath`: write a recipe's checked G-code, and a map of lines to vessels or layers."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from design.files import atomic_replacement
from printctl.cli.options import (
    JsonFlag,
    RecipeArg,
    messages,
    print_json,
    print_lines,
    print_note,
    refuse_input_as_output,
)
from printctl.cli.plan_lines import plan_lines
from printctl.cli.process_lines import process_lines
from printctl.errors import UsageError
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import load_recipe
from printctl.run_folder.artefacts import GCODE, LINE_MAP, PLATE_PICTURE, PLATE_TABLE


def toolpath(
    recipe: RecipeArg,
    out: Annotated[Path, typer.Option("--out", help="G-code file to write.", show_default=False)],
    as_json: JsonFlag = False,
) -> None:
    """Write a recipe's G-code after its dry run, with FILE.map.npz (line to vessel or layer).

    Of a plate with FILE.wells.csv and a picture, FILE.svg.
    """
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give the name of a .gcode file in it")
    refuse_input_as_output(out, recipe)
    loaded = load_recipe(recipe, print_note)
    with tempfile.TemporaryDirectory() as scratch:
        data = toolpath_recipe(loaded, recipe.resolve().parent, Path(scratch), messages())
        beside = [(LINE_MAP, out.with_suffix(".map.npz")), (GCODE, out)]
        if loaded.plate is not None:
            beside += [
                (PLATE_TABLE, out.with_suffix(".wells.csv")),
                (PLATE_PICTURE, out.with_suffix(".svg")),
            ]
        for name, place in beside:
            with atomic_replacement(place) as draft:
                shutil.copyfile(Path(scratch) / name, draft)
    if as_json:
        print_json(data)
        return
    print_lines(
        f"{data['toolpath']['lines']} lines, {data['toolpath']['written_ul']:.4g} µL, "
        f"{data['dry_run']['duration_s'] / 60:.1f} min",
        *process_lines(data["dry_run"]),
        *plan_lines(data["toolpath"].get("plan", {})),
        str(out),
    )
