"""`printctl run`: the whole recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.cli.options import (
    JsonFlag,
    RecipeArg,
    YesFlag,
    messages,
    print_json,
    print_lines,
    tell,
)
from printctl.cli.pdf_option import PdfFlag
from printctl.cli.process_lines import process_lines
from printctl.pipeline.artefacts import HTML, PDF
from printctl.pipeline.run import run_recipe
from printctl.recipe import load_recipe

OutOption = Annotated[
    Path | None, typer.Option("--out", help="Run folder; runs/NAME by default.", show_default=False)
]


def run(
    recipe: RecipeArg,
    out: OutOption = None,
    yes: YesFlag = False,
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Run a recipe from tissue to report; a stage whose inputs are as before isn't done again.

    Exit code 1 when the print doesn't pass, 3 when a safety check refuses it, 4 when the printer
    fails.
    """
    loaded = load_recipe(recipe, tell)
    folder = out if out is not None else Path("runs") / loaded.name
    data = run_recipe(loaded, recipe.resolve().parent, folder, messages(), assume_yes=yes, pdf=pdf)
    verdict = data["verdict"]
    if as_json:
        print_json(data)
    else:
        print_lines(
            *process_lines(data["dry_run"]),
            ("pass: " if verdict["passed"] else "fail: ") + "; ".join(verdict["reasons"]),
            str(folder / HTML),
            *(pdfs(data, folder) if pdf else []),
        )
    if not verdict["passed"]:
        raise typer.Exit(1)


def pdfs(data: dict[str, Any], folder: Path) -> list[str]:
    """Where the PDFs lie: the run's, or of a plate one for each well that was scanned."""
    if "plate" not in data:
        return [str(folder / PDF)]
    return [str((folder / row["report"]).parent / PDF) for row in data["scanned"]]
