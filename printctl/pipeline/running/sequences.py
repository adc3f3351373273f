"""Lists of the pipeline stages in running order: design, job and whole run."""

from __future__ import annotations

from collections.abc import Sequence

from printctl.pipeline.run_options import names_until
from printctl.pipeline.running.run_stages import DESIGN
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages import printing, registration, scan
from printctl.pipeline.stages.design import tissue, vasculature
from printctl.pipeline.stages.paths import dry_run, lumens, toolpath
from printctl.recipe import Recipe
from printctl.recipe.sections.toolpath import Embedded

JOB: Sequence[Stage] = (toolpath.STAGE, dry_run.STAGE, lumens.STAGE)
TOOLPATH: Sequence[Stage] = (*DESIGN, *JOB)
WHOLE: Sequence[Stage] = (*TOOLPATH, printing.STAGE, scan.STAGE, registration.STAGE)


def in_order(stages: Sequence[Stage], recipe: Recipe) -> Sequence[Stage]:
    """Return the stages in order, those first that may refuse early.

    A path along centrelines needs the network alone: it is planned and checked before anything is
    computed or united that a refusal would make useless. With a compensation it needs the solid.
    """
    if not along_centrelines(recipe):
        return stages
    first = [stage for stage in stages if stage in (tissue.STAGE, vasculature.STAGE)]
    job = [stage for stage in stages if stage in JOB]
    return [*first, *job, *(stage for stage in stages if stage not in first and stage not in job)]


def along_centrelines(recipe: Recipe) -> bool:
    """Whether the path is planned from the network alone."""
    return isinstance(recipe.toolpath, Embedded) and recipe.toolpath.compensation is None


def stages_until(name: str) -> Sequence[Stage]:
    """The stages of a run up to one of them, as `names_until`.

    Raises
    ------
    UsageError
        When there is no such stage.
    """
    return WHOLE[: len(names_until(name))]
