"""Stage 6: the dry run, which refuses to go on when a check fails."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from design.files import write_text
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.toolpath import GCODE
from printctl.preflight import (
    Check,
    bath_check,
    crossings_check,
    gcode_checks,
    needle_check,
    refuse_failed,
    syringe_check,
)
from printctl.progress import Report
from printctl.recipe.making import Fresh
from sim.dryrun import DryRun, dry_run

CHECKS = "dry_run.json"


def depends(context: RunContext) -> Any:
    """Everything that a check looks at, besides the G-code."""
    profiles = (context.printer, context.needle, context.syringe, context.bath)
    part = context.recipe.toolpath.model_dump(mode="json")
    return [
        part,
        [profile.model_dump(mode="json") for profile in profiles],
        context.start_mm.tolist(),
    ]


def all_checks(context: RunContext, run: DryRun) -> list[Check]:
    """The G-code's own checks and those of the set-up."""
    low, high = context.tissue.bounds
    part = context.recipe.toolpath
    planned = context.manifest.stages["toolpath"].summary["plan"]
    crossings = (
        []
        if isinstance(part, Fresh)
        else [crossings_check(len(planned["crossings"]), part.allowed_crossings)]
    )
    return [
        *gcode_checks(run, context.printer),
        syringe_check(run, context.syringe),
        needle_check(float(high[2] - low[2]), context.needle),
        *bath_check(context.bath),
        *crossings,
    ]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Run the file through the planner; refuse when anything is wrong."""
    x, y, z = context.start_mm.tolist()
    run = dry_run((context.folder / GCODE).read_bytes(), context.printer, (x, y, z))
    checks = all_checks(context, run)
    summary = {
        "duration_s": run.duration_s,
        "merged_moves": run.merged_moves,
        "checks": [check.as_dict() for check in checks],
    }
    write_text(context.folder / CHECKS, json.dumps(summary, indent=1) + "\n")
    refuse_failed(checks)
    return summary, [CHECKS]


STAGE = Stage("dry run", depends, (GCODE,), ("kernels", "sim", "firmware_profiles"), work)
