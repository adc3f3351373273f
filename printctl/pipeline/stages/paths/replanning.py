"""Try remedies for a refused layered job by planning it again with one key changed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from rich.console import Console

from design.errors import DesignError
from kernels.arrays import FloatArray
from printctl.checks.lumens import LumenCheck
from printctl.checks.lumens.walls import with_walls
from printctl.errors import PrintctlError
from printctl.pipeline.context import RunContext
from printctl.pipeline.stages.design import solid, tissue, vasculature
from printctl.pipeline.stages.design.regrowing import Change, grown
from printctl.pipeline.stages.paths import toolpath
from printctl.progress import StageBars
from printctl.recipe import Recipe
from printctl.recipe.sections.growth import Growth
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.manifest import Manifest

TRIAL_S: Final = 60.0
"""Time for all trials; one isn't begun where the job itself took a third of it to plan."""
STAGES: Final = (tissue.STAGE, vasculature.STAGE, solid.STAGE, toolpath.STAGE)


def quiet(fraction: float, note: str = "") -> None:
    """Report nothing."""


def explained(
    context: RunContext, check: LumenCheck, passes: Callable[[RunContext], bool]
) -> LumenCheck:
    """The check with the walls where it leaks, and with a remedy that was tried.

    Parameters
    ----------
    context : RunContext
        Whose job was refused.
    check : LumenCheck
    passes : function
        Whether a job that was planned again is to be printed.
    """
    scale, grid = context.recipe.print_scale, context.tissue.grid

    def depth(points: FloatArray) -> FloatArray:
        value: FloatArray = -scale * grid.distance(points / scale)
        return value

    if context.recipe.toolpath.compensation is not None or context.stand is not None:
        return check
    leaks = with_walls(check.leaks, context.written_network, depth)
    check = replace(check, leaks=leaks)
    return replace(check, remedy=_tried(context, check, passes))


def _tried(context: RunContext, check: LumenCheck, passes: Callable[[RunContext], bool]) -> str:
    """What helps, as far as it was tried; empty where nothing could be."""
    names = [stage.name for stage in STAGES]
    records = context.manifest.stages
    took = sum(records[name].seconds for name in names if name in records)
    begin, failed = time.monotonic(), []
    for change in _changes(context.recipe, check):
        if time.monotonic() - begin + took > TRIAL_S or took > TRIAL_S / 3:
            break
        with suppress(DesignError, PrintctlError):
            if _holds(context, change.recipe, passes):
                return f"{change.text}; planned again with this change, it passes"
        failed.append(change.text)
    if not failed:
        return ""
    need = check.by_geometry()
    return f"{need} ({', '.join(failed)} tried: refused too)"


def _holds(context: RunContext, recipe: Recipe, passes: Callable[[RunContext], bool]) -> bool:
    """Whether the job passes with another recipe."""
    with TemporaryDirectory(prefix="printctl-trial-") as name:
        folder = Path(name)
        trial = RunContext(
            recipe,
            context.recipe_folder,
            folder,
            Manifest.load(folder),
            StageBars(Console(quiet=True)),
            ink_changes=context.ink_changes,
            trial=True,
        )
        for stage in STAGES:
            stage.work(trial, quiet)
        return passes(trial)


def _changes(recipe: Recipe, check: LumenCheck) -> Iterator[Change]:
    """Changes that may help, the mildest first."""
    part, making = recipe.vasculature, recipe.toolpath
    if not isinstance(making, Fresh):
        return
    closed = bool((check.ideal.closed | check.stepped.closed).any())
    if isinstance(part, Growth):
        if check.leaks:
            yield from _default_root(recipe, part)
            for factor in (1.0, 1.5, 2.5):
                wall = round(factor * check.line_mm / recipe.print_scale, 2)
                if wall > part.clearance_mm:
                    yield grown(recipe, clearance_mm=wall)
        if closed and part.smallest_diameter_mm is not None:
            for factor in (1.25, 1.5):
                width = round(factor * part.smallest_diameter_mm, 3)
                yield grown(recipe, smallest_diameter_mm=width)
    if any(leak.wall_mm is not None and leak.wall_mm <= 0 for leak in check.leaks):
        return  # lines make no wall that the design lacks
    for factor in (0.8, 0.65):
        line = round(factor * making.line_um)
        finer = making.model_copy(update={"line_um": float(line)})
        yield Change(f"toolpath.line_um: {line}", recipe.model_copy(update={"toolpath": finer}))


def _default_root(recipe: Recipe, part: Growth) -> Iterator[Change]:
    """The recipe without the root that it names."""
    named = [key for key in ("root", "root_mm", "root_direction") if getattr(part, key, None)]
    if named:
        text = f"remove vasculature.{', '.join(named)} (the root then lies inside a face)"
        yield grown(recipe, text, **dict.fromkeys(named))
