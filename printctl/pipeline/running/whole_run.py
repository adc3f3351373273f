"""Lock the run folder and run a recipe's wanted stages, for a single part or a well plate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from printctl.errors import UsageError
from printctl.pipeline.context import RunContext
from printctl.pipeline.observing import order_observer
from printctl.pipeline.run_options import RunOptions
from printctl.pipeline.running.plate.run import design_plate, run_plate, toolpath_plate
from printctl.pipeline.running.run_stages import DESIGN, begun_run, run_all
from printctl.pipeline.running.sequences import (
    TOOLPATH,
    WHOLE,
    along_centrelines,
    in_order,
    stages_until,
)
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages import report
from printctl.pipeline.stages.collect import collect
from printctl.pipeline.stages.design import solid
from printctl.recipe import Recipe


def run_wanted(
    recipe: Recipe, recipe_folder: Path, folder: Path, console: Console, how: RunOptions
) -> dict[str, Any]:
    """Run the stages as `printctl.pipeline.running.run.run_recipe` says."""
    stages = in_order(WHOLE if how.until is None else stages_until(how.until), recipe)
    if how.gcode_alone and recipe.plate is None and along_centrelines(recipe):
        stages = [stage for stage in stages if stage is not solid.STAGE]
    with begun_run(recipe, recipe_folder, folder, console, how, stages) as context:
        if recipe.plate is not None:
            return _plate(context, how, stages)
        run_all(context, stages)
        if how.until is None:
            return report.write_report(context, how.pdf)
        order_observer(context)  # for a print from the operator's page
        return collect(context)


def _plate(context: RunContext, how: RunOptions, stages: Sequence[Stage]) -> dict[str, Any]:
    if how.printed:
        raise UsageError("--printed takes the print of one part; leave it out with a plate")
    if how.until is None:
        return run_plate(context, how.pdf)
    for last, work in ((TOOLPATH[-1], toolpath_plate), (DESIGN[-1], design_plate)):
        if how.until is not None and stages_until(how.until)[-1] is last:
            return work(context)
    raise UsageError(
        f"a plate can't end at {how.until}: its wells go together as far as {DESIGN[-1].name}, "
        f"and then as far as {TOOLPATH[-1].name}; give one of these"
    )
