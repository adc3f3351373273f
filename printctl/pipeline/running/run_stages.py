"""Run stages in a locked run folder, skipping those up to date; a part's design stages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from design.files import atomic_replacement
from printctl.pipeline.context import RunContext
from printctl.pipeline.facts import run_facts
from printctl.pipeline.past.evidence import keep_earlier
from printctl.pipeline.run_options import DESIGN_NAMES, RunOptions, names_until
from printctl.pipeline.running.lock import run_lock
from printctl.pipeline.stage import RunMeter, Stage
from printctl.pipeline.stages import measures
from printctl.pipeline.stages.collect import collect
from printctl.pipeline.stages.design import solid, tissue, vasculature
from printctl.pipeline.stages.perfusion import fidelities, flow, oxygen
from printctl.progress import Report, StageBars
from printctl.recipe import Recipe
from printctl.run_folder.manifest import Manifest, StageRecord, digest_file

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
    begin_facts(context)
    run_stages(context, stages, context.bars)


def begin_facts(context: RunContext) -> None:
    """Note where and with what the run is made; what that would replace of a print is put by."""
    facts = run_facts(context)
    if kept := keep_earlier(context.folder, facts):
        context.bars.say("earlier print", f"kept in {kept}, as inputs or build differ now")
    context.manifest.facts = facts
    context.manifest.save()


def run_stages(context: RunContext, stages: Sequence[Stage], bars: StageBars) -> None:
    """Run each stage whose inputs have changed; reuse the others.

    The record of a stage is dropped before it runs, so that a stage that fails half-way isn't
    taken for done.
    """
    with bars.all():
        for stage in wanted_stages(context, stages):
            name = f"{context.title} {stage.name}".strip()
            with bars.stage(name) as report:
                note = _run_one(context, stage, report)
            bars.say(name, note)


def run_under_one_bar(
    context: RunContext, stages: Sequence[Stage], bars: StageBars, name: str
) -> None:
    """Run stages as `run_stages`, under one bar: of many parts that are all made alike."""
    with bars.all(), bars.stage(name) as report, RunMeter() as meter:
        notes = []
        stages = wanted_stages(context, stages)
        for number, stage in enumerate(stages):
            report(number / len(stages), stage.name)
            notes.append(_run_one(context, stage, lambda fraction, note="": None))
    new = [note for note in notes if note.endswith(" s")]
    kept = f", {len(notes) - len(new)} of {len(notes)} stages as before or as in another well"
    bars.say(name, f"{meter.seconds:.1f} s{kept if len(new) < len(notes) else ''}")


def wanted_stages(context: RunContext, stages: Sequence[Stage]) -> list[Stage]:
    """The stages that the recipe asks for; what an earlier recipe asked for is forgotten."""
    for stage in stages:
        if not stage.asked(context):
            context.manifest.stages.pop(stage.name, None)
    return [stage for stage in stages if stage.asked(context)]


def _run_one(context: RunContext, stage: Stage, report: Report) -> str:
    key = stage.key(context)
    record = context.manifest.stages.get(stage.name)
    if record is not None and record.still_valid(key, context.folder):
        context.reused.add(stage.name)
        return f"unchanged ({record.seconds:.1f} s when made)"
    for other in context.siblings:
        theirs = other.manifest.stages.get(stage.name)
        if theirs is not None and theirs.still_valid(key, other.folder):
            _take_over(context, stage, theirs, other.folder)
            return f"as in {other.folder.name}"
    context.manifest.stages.pop(stage.name, None)
    with RunMeter() as meter:
        summary, outputs = stage.work(context, report)
    digests = {name: digest_file(context.folder / name) for name in outputs}
    context.manifest.stages[stage.name] = StageRecord(
        key, digests, summary, round(meter.seconds, 3), round(meter.peak_mb, 1)
    )
    context.manifest.save()
    return f"{meter.seconds:.1f} s"


def _take_over(context: RunContext, stage: Stage, record: StageRecord, folder: Path) -> None:
    """Copy what another folder's run of the same made."""
    context.manifest.stages.pop(stage.name, None)
    for name in record.outputs:
        with atomic_replacement(context.folder / name) as draft:
            shutil.copyfile(folder / name, draft)
    context.manifest.stages[stage.name] = record
    context.manifest.save()
    context.reused.add(stage.name)
