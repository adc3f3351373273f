"""Run a part's design stages in a locked run folder; begin any run and its list of stages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from printctl.pipeline.context import RunContext
from printctl.pipeline.facts import run_facts
from printctl.pipeline.lock import run_lock
from printctl.pipeline.run_options import DESIGN_NAMES, RunOptions, names_until
from printctl.pipeline.stage import Stage, run_stages
from printctl.pipeline.stages import fidelities, flow, measures, oxygen, solid, tissue, vasculature
from printctl.pipeline.stages.collect import collect
from printctl.progress import StageBars
from printctl.recipe import Recipe
from printctl.run_folder.manifest import Manifest

DESIGN: Sequence[Stage] = (
    tissue.STAGE,
    vasculature.STAGE,
    flow.STAGE,
    fidelities.STAGE,
    measures.STAGE,
    oxygen.STAGE,
    solid.STAGE,
)


def run_design(
    recipe: Recipe, recipe_folder: Path, folder: Path, console: Console, how: RunOptions
) -> dict[str, Any]:
    """Run the design stages of a single part up to ``how.until``; return their summaries."""
    stages = DESIGN[: len(names_until(how.until or DESIGN_NAMES[-1]))]
    with begun_run(recipe, recipe_folder, folder, console, how, stages) as context:
        run_all(context, stages)
        return collect(context)


@contextmanager
def begun_run(
    recipe: Recipe,
    recipe_folder: Path,
    folder: Path,
    console: Console,
    how: RunOptions,
    stages: Sequence[Stage],
) -> Iterator[RunContext]:
    """Lock the folder, make the run's context, and tell the listener which stages come."""
    with run_lock(folder):
        context = RunContext(
            recipe,
            recipe_folder,
            folder,
            Manifest.load(folder),
            StageBars(console, how.listener),
            how.assume_yes,
            printed=how.printed,
            rehearsal_speed=how.rehearse,
        )
        if how.listener is not None:
            names = [stage.name for stage in stages if stage.asked(context)]
            how.listener.begin(names, stages[-1].name)
        yield context


def run_all(context: RunContext, stages: Sequence[Stage]) -> None:
    """Note where and with what the run is made, and run its stages."""
    context.manifest.facts = run_facts(context)
    context.manifest.save()
    run_stages(context, stages, context.bars)
