"""`printctl run`: run a recipe from tissue design through print and scan to the report."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.cli.kernels_ready import kernels_for_a_run
from printctl.cli.observe_looks import looks_lines
from printctl.cli.options import (
    JsonFlag,
    RecipeArg,
    YesFlag,
    folder_to_write,
    messages,
    print_json,
    print_lines,
    print_note,
)
from printctl.cli.pdf_option import PdfFlag
from printctl.cli.process_lines import process_lines
from printctl.cli.progress_option import ProgressFileOption, message_of
from printctl.history.table import outcome
from printctl.pipeline.run import RunOptions, run_recipe
from printctl.pipeline.run_options import DESIGN_NAMES
from printctl.progress_file import ProgressFile
from printctl.recipe import Recipe, load_recipe
from printctl.recipe.growth import Growth
from printctl.run_folder.artefacts import HTML, PDF

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        callback=folder_to_write,
        help="Run folder; runs/NAME by default.",
        show_default=False,
    ),
]
UntilOption = Annotated[
    str | None,
    typer.Option(
        "--until",
        metavar="STAGE",
        help="Last stage: tissue, vasculature, flow, fidelities, measures, oxygen, solid, "
        "toolpath, dry-run, lumens, print, scan or registration. Nothing is printed before print.",
    ),
]
PrintedFlag = Annotated[
    bool,
    typer.Option(
        "--printed", help="Take the print that is done in the run folder; nothing is printed."
    ),
]


def run(
    recipe: RecipeArg,
    out: OutOption = None,
    until: UntilOption = None,
    printed: PrintedFlag = False,
    progress_file: ProgressFileOption = None,
    yes: YesFlag = False,
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Run a recipe from tissue to report; a stage whose inputs are as before isn't done again.

    Exit code 1 when the print doesn't pass, 3 when a safety check refuses it, 4 when the printer
    fails.
    """
    progress = None if progress_file is None else ProgressFile(progress_file)
    with nullcontext() if progress is None else progress.whole(message_of):
        loaded = load_recipe(recipe, print_note)
        folder = out if out is not None else Path("runs") / loaded.name
        how = RunOptions(assume_yes=yes, pdf=pdf, until=until, printed=printed, listener=progress)
        with kernels_for_a_run(*_works(loaded, until), listener=progress):
            data = run_recipe(loaded, recipe.resolve().parent, folder, messages(), how)
    if as_json:
        print_json(data)
    else:
        print_lines(*_ended(data, folder, until, pdf))
    if until is None and not data["verdict"]["passed"]:
        raise typer.Exit(1)


def _works(recipe: Recipe, until: str | None) -> list[str]:
    """What of the list of kernels the stages need."""
    grown = isinstance(recipe.vasculature, Growth)
    designed = until in DESIGN_NAMES
    beside = recipe.oxygen is not None or recipe.flow.pulse is not None
    return [
        *(["design"] if grown or designed else []),
        *([] if designed else [f"run {recipe.toolpath.method}"]),
        *(["pulse and oxygen"] if beside else []),
    ]


def _ended(data: dict[str, Any], folder: Path, until: str | None, pdf: bool) -> list[str]:
    """What is said at the end."""
    process = process_lines(data["dry_run"]) if "dry_run" in data else []
    process += looks_lines(folder)
    if until is not None:
        return [*process, f"done as far as {until}", str(folder)]
    verdict = data["verdict"]
    return [
        *process,
        outcome(verdict),
        *verdict["reasons"],
        str(folder / HTML),
        *(pdfs(data, folder) if pdf else []),
    ]


def pdfs(data: dict[str, Any], folder: Path) -> list[str]:
    """Where the PDFs lie: the run's, or of a plate one for each well that was scanned."""
    if "plate" not in data:
        return [str(folder / PDF)]
    return [str((folder / row["report"]).parent / PDF) for row in data["scanned"]]
