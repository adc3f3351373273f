"""Run a recipe: all of it, or as far as the design or the G-code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from printctl.pipeline.context import RunContext
from printctl.pipeline.facts import run_facts
from printctl.pipeline.lock import run_lock
from printctl.pipeline.manifest import Manifest
from printctl.pipeline.plate.run import design_plate, run_plate, toolpath_plate
from printctl.pipeline.sequences import DESIGN, TOOLPATH, WHOLE
from printctl.pipeline.stage import Stage, run_stages
from printctl.pipeline.stages import report
from printctl.progress import StageBars
from printctl.recipe import Recipe


def run_recipe(
    recipe: Recipe,
    recipe_folder: Path,
    folder: Path,
    console: Console,
    *,
    assume_yes: bool = False,
    pdf: bool = False,
) -> dict[str, Any]:
    """Run all stages in ``folder`` and write the report; return report.json's content.

    Before a print on a real printer starts, the user is asked, unless ``assume_yes``. With
    ``pdf`` the report is written as a PDF too.

    Raises
    ------
    PrintctlError, DesignError, RegistrationError, LinkError, ProfileError, OSError
        Whatever stopped it; finished stages are kept and reused by the next run.
    """
    with run_lock(folder):
        if recipe.plate is not None:
            return run_plate(_context(recipe, recipe_folder, folder, console, assume_yes), pdf)
        context = _run(recipe, recipe_folder, folder, console, WHOLE, assume_yes)
        return report.write_report(context, pdf)


def design_recipe(
    recipe: Recipe, recipe_folder: Path, folder: Path, console: Console
) -> dict[str, Any]:
    """Run the design stages; return their summaries."""
    with run_lock(folder):
        if recipe.plate is not None:
            return design_plate(_context(recipe, recipe_folder, folder, console))
        return report.collect(_run(recipe, recipe_folder, folder, console, DESIGN))


def toolpath_recipe(
    recipe: Recipe, recipe_folder: Path, folder: Path, console: Console
) -> dict[str, Any]:
    """Run the stages up to the dry run; return their summaries."""
    with run_lock(folder):
        if recipe.plate is not None:
            return toolpath_plate(_context(recipe, recipe_folder, folder, console))
        return report.collect(_run(recipe, recipe_folder, folder, console, TOOLPATH))


def _run(
    recipe: Recipe,
    recipe_folder: Path,
    folder: Path,
    console: Console,
    stages: Sequence[Stage],
    assume_yes: bool = False,
) -> RunContext:
    context = _context(recipe, recipe_folder, folder, console, assume_yes)
    context.manifest.facts = run_facts(context)
    context.manifest.save()
    run_stages(context, stages, context.bars)
    return context


def _context(
    recipe: Recipe, recipe_folder: Path, folder: Path, console: Console, assume_yes: bool = False
) -> RunContext:
    manifest = Manifest.load(folder)
    return RunContext(recipe, recipe_folder, folder, manifest, StageBars(console), assume_yes)
