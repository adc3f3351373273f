"""The stages of a run in their order: the design, as far as the job, and all of them."""

from __future__ import annotations

from collections.abc import Sequence

from printctl.pipeline.names import names_until
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages import (
    dry_run,
    fidelities,
    flow,
    lumens,
    measures,
    oxygen,
    printing,
    registration,
    scan,
    solid,
    tissue,
    toolpath,
    vasculature,
)

DESIGN: Sequence[Stage] = (
    tissue.STAGE,
    vasculature.STAGE,
    flow.STAGE,
    fidelities.STAGE,
    measures.STAGE,
    oxygen.STAGE,
    solid.STAGE,
)
JOB: Sequence[Stage] = (toolpath.STAGE, dry_run.STAGE, lumens.STAGE)
TOOLPATH: Sequence[Stage] = (*DESIGN, *JOB)
WHOLE: Sequence[Stage] = (*TOOLPATH, printing.STAGE, scan.STAGE, registration.STAGE)


def until(name: str) -> Sequence[Stage]:
    """The stages of a run up to one of them, as `names_until`.

    Raises
    ------
    UsageError
        When there is no such stage.
    """
    return WHOLE[: len(names_until(name))]
