"""Run a recipe, whole or up to design or checked G-code; first refuse what can't be printed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from printctl.errors import RecipeError, UsageError
from printctl.machine.process.simulated import was_simulated
from printctl.machine.records.record import RECORD
from printctl.pipeline.run_options import (
    DESIGN_NAMES,
    JOB_NAMES,
    SIMULATED_PORT,
    TOOLPATH_NAMES,
    WHOLE_NAMES,
    RunOptions,
    names_until,
)
from printctl.recipe import Recipe
from printctl.recipe.sections.measuring import FileScan
from printctl.run_folder.artefacts import JOURNAL_FOLDER

__all__ = ["RunOptions", "design_recipe", "run_recipe", "toolpath_recipe"]

_ALL: Final = RunOptions()
MAX_REHEARSAL_SPEED: Final = 1000.0
"""Times real time; a simulated printer that is to be faster needs no clock (0)."""


def run_recipe(
    recipe: Recipe,
    recipe_folder: Path,
    folder: Path,
    console: Console,
    how: RunOptions = _ALL,
) -> dict[str, Any]:
    """Run the stages in ``folder`` and write the report; return report.json's content.

    What the recipe's files and profiles refuse by themselves is refused first. Before a print on
    a real printer starts, the user is asked, unless ``how.assume_yes``. With ``how.until`` the
    summaries of the stages up to that one are returned.

    Raises
    ------
    UsageError
        For a stage that isn't known, or a file that isn't there.
    RecipeError
        For a print on a real printer whose scan would be simulated.
    ServeError
        For a fault file of the printer's that isn't one.
    PrintctlError, DesignError, RegistrationError, LinkError, ProfileError, OSError
        Whatever stopped it; finished stages are kept and reused by the next run.
    """
    if how.rehearse is not None:
        recipe = _rehearsed(recipe, how, folder)
    for name in recipe.files():
        if not (recipe_folder / name).exists():
            raise UsageError(f"{recipe_folder / name}, which the recipe names, isn't there; "
                             "check the path, relative to the recipe")  # fmt: skip
    if recipe.printer.faults is not None:
        from sim.devices.faults import FaultFile  # the simulator's; few recipes name any

        FaultFile.load(recipe_folder / recipe.printer.faults)  # A wrong one is refused at once.
    names = WHOLE_NAMES if how.until is None else names_until(how.until)
    if "print" in names:
        _refuse_pretended_scan(recipe)
    _refuse_missing_extras(recipe, recipe_folder, names)
    if JOB_NAMES[0] in names:
        from printctl.pipeline.refusals import refuse_before  # a design needs none of it

        refuse_before(recipe, recipe_folder)
        if recipe.assumed_parts:
            taken = ", ".join(f"{part} {name}" for part, name in recipe.assumed_parts.items())
            console.print(f"note: assumed {taken}, as the recipe names no other", markup=False)
    elif recipe.plate is None:
        from printctl.pipeline.running.run_stages import (
            run_design,  # loads the design's stages alone
        )

        return run_design(recipe, recipe_folder, folder, console, how)
    # What does the work takes seconds to load; a refusal doesn't wait for it.
    from printctl.pipeline.running.whole_run import run_wanted

    return run_wanted(recipe, recipe_folder, folder, console, how)


def _refuse_missing_extras(recipe: Recipe, recipe_folder: Path, names: Sequence[str]) -> None:
    """Raise before a tree is grown if a stage needs a package that isn't installed.

    The packages are heavy, and few recipes need them.
    """
    if "solid" in names and "step" in recipe.solid.formats:
        from design.solids.files.step import load_occ

        load_occ()
    if "flow" in names and recipe.flow.three_d is not None:
        from design.hemodynamics.three_d.engine import load_engine

        load_engine()
    if "scan" in names and isinstance(recipe.scan, FileScan):
        from registration.files.readers.common import check_extra

        check_extra(recipe_folder / recipe.scan.file)


def _refuse_pretended_scan(recipe: Recipe) -> None:
    """Raise RecipeError for a real print whose scan would be simulated; design and rehearse it."""
    if not isinstance(recipe.scan, FileScan) and recipe.printer.port != SIMULATED_PORT:
        raise RecipeError(
            "a simulated scan needs what the simulated printer deposited, but printer.port is "
            f"{recipe.printer.port}; give scan.file (it may come into being after the print), "
            "or port: simulated"
        )


def design_recipe(
    recipe: Recipe,
    recipe_folder: Path,
    folder: Path,
    console: Console,
    until: str = DESIGN_NAMES[-1],
) -> dict[str, Any]:
    """Run the design stages up to ``until``; return their summaries."""
    return run_recipe(recipe, recipe_folder, folder, console, RunOptions(until=until))


def toolpath_recipe(
    recipe: Recipe, recipe_folder: Path, folder: Path, console: Console
) -> dict[str, Any]:
    """Run the stages up to the checked G-code; return their summaries.

    The solid of a network that is written along its centrelines isn't built.
    """
    how = RunOptions(until=TOOLPATH_NAMES[-1], gcode_alone=True)
    return run_recipe(recipe, recipe_folder, folder, console, how)


def _rehearsed(recipe: Recipe, how: RunOptions, folder: Path) -> Recipe:
    """Return the recipe with the simulated printer and scanner in the place of its own.

    Raises
    ------
    UsageError
        Where a real print is to be taken or lies in the folder, or for a speed that can't be had.
    """
    real = folder / JOURNAL_FOLDER
    if (real / RECORD).is_file() and not was_simulated(real):
        raise UsageError(
            f"{folder} holds what was printed for real; rehearse in another folder (--out)"
        )
    if how.printed:
        raise UsageError("--printed takes a print that was done; leave --rehearse out")
    if how.rehearse is not None and not 0 <= how.rehearse <= MAX_REHEARSAL_SPEED:
        raise UsageError(
            f"--rehearse {how.rehearse:g} isn't between 0 (as fast as it can) and "
            f"{MAX_REHEARSAL_SPEED:g} times real time"
        )
    printer = recipe.printer.model_copy(update={"port": SIMULATED_PORT})
    scan = (
        None if isinstance(recipe.scan, FileScan) else recipe.scan
    )  # a file's is of another print
    return recipe.model_copy(update={"printer": printer, "scan": scan})
