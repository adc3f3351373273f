"""`printctl run`: the whole recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from printctl.cli.options import JsonFlag, RecipeArg, messages, print_json, print_lines
from printctl.pipeline import run_recipe
from printctl.recipe import load_recipe

OutOption = Annotated[
    Path | None, typer.Option("--out", help="Run folder; runs/NAME by default.", show_default=False)
]


def run(recipe: RecipeArg, out: OutOption = None, as_json: JsonFlag = False) -> None:
    """Run a recipe from tissue to report; a stage whose inputs are as before isn't done again."""
    loaded = load_recipe(recipe)
    folder = out if out is not None else Path("runs") / loaded.name
    data = run_recipe(loaded, recipe.resolve().parent, folder, messages())
    if as_json:
        print_json(data)
        return
    verdict = data["verdict"]
    print_lines(
        ("pass: " if verdict["passed"] else "fail: ") + "; ".join(verdict["reasons"]),
        str(folder / "report.html"),
    )
