"""The stages of a run in their order: the design, as far as the job, and all of them."""

from __future__ import annotations

from collections.abc import Sequence

from printctl.errors import UsageError
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
    """The stages of a run up to one of them.

    Parameters
    ----------
    name : str
        As the run shows it; ``-`` or ``_`` may stand for the space in ``dry run``.

    Raises
    ------
    UsageError
        When there is no such stage.
    """
    names = [stage.name for stage in WHOLE]
    wanted = name.strip().lower().replace("-", " ").replace("_", " ")
    if wanted not in names:
        raise UsageError(f"there is no stage {name!r}; a run has: {', '.join(names)}")
    return WHOLE[: names.index(wanted) + 1]
