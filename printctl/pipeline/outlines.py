"""Outlines of a run's designed part at each layer, to draw over the layers of its G-code."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rich.console import Console

from design.toolpath.fresh import Compensation
from printctl.checks.gcode_view.outline import Design, PartOutlines
from printctl.errors import UsageError
from printctl.pipeline.apply_compensation import written_solid
from printctl.pipeline.context import RunContext
from printctl.pipeline.written_layers import run_context
from printctl.recipe.making import Fresh
from registration.report.gcode import GcodeJob
from registration.report.gcode.outline_pack import beyond_um

_FAR_UM: Final = 150.0


def outlined_design(context: RunContext) -> Design | None:
    """The part as it is to be written and its place; None where nothing is written in layers."""
    part = context.recipe.toolpath
    if not isinstance(part, Fresh):
        return None
    larger = Compensation(part.compensate.shrink_percent)
    return larger.enlarged(written_solid(context)), context.place_mm


def run_outlines(run: Path, job: GcodeJob) -> PartOutlines | None:
    """Outlines of a run folder's layers.

    None where the run has no layers or not all its files, or where its lines don't lie in its part
    (a well of a plate, which stands elsewhere in the plate's job).
    """
    try:
        design = outlined_design(run_context(run, Console(quiet=True)))
    except UsageError:
        return None
    if design is None or job.layers.passes:
        return None
    outlines = PartOutlines(job, *design)
    beyond = beyond_um(outlines.at((len(job.layers) - 1) // 2))
    return outlines if beyond and abs(beyond[1]) < _FAR_UM else None
