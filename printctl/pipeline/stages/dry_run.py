"""Stage 6: the dry run, which refuses to go on when a check fails."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from design.files import write_text
from printctl.link.job import parse_job
from printctl.pipeline.context import NETWORK, RunContext
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.toolpath import GCODE
from printctl.preflight import (
    Check,
    PrintTime,
    Standing,
    bath_checks,
    budget_of,
    chemistry_check,
    crossings_check,
    dish_checks,
    floor_check,
    force_checks,
    gcode_checks,
    held_check,
    ink_use,
    needle_check,
    refuse_failed,
    step_checks,
    syringe_checks,
    temperature_checks,
    unknown_dish,
    viability_checks,
    viability_facts,
    warnings,
)
from printctl.printing import usable_mm, with_reloads
from printctl.progress import Report
from printctl.recipe.making import Fresh
from sim.dryrun import DryRun, dry_run

CHECKS = "dry_run.json"


def depends(context: RunContext) -> Any:
    """Everything that a check looks at, besides the G-code."""
    profiles = (context.printer, context.needle, context.syringe, context.ink, context.bath)
    part, at = context.recipe.toolpath.model_dump(mode="json"), context.recipe.printer
    return [
        part,
        [profile.model_dump(mode="json") for profile in profiles],
        context.start_mm.tolist(),
        context.dish and context.dish.model_dump(mode="json"),
        [at.dish_centre_mm, at.bath_depth_mm, at.care.reload],
        [at.care.reload_min, at.care.viability_min, at.care.viability_source],
    ]


def all_checks(context: RunContext, run: DryRun) -> list[Check]:
    """The G-code's own checks and those of the set-up."""
    low, high = context.tissue.bounds
    ink, bath, needle = context.ink, context.bath, context.needle
    return [
        *gcode_checks(run, context.printer),
        *syringe_checks(run, context.printer, context.syringe),
        *step_checks(run, context.printer, context.syringe),
        needle_check(float(high[2] - low[2]), needle),
        *force_checks(run, ink, needle, context.syringe, context.printer),
        chemistry_check(ink, bath),
        *bath_checks(bath),
        *temperature_checks(run, ink, bath),
        held_check(widest_filament_mm(context), ink, bath),
        floor_check(run, bath, context.printer.z_mm.low),
        *in_the_dish(context, run),
        *crossings(context),
    ]


def widest_filament_mm(context: RunContext) -> float:
    """Thickest filament that is written: a vessel, or in layers a line."""
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        return part.line_um * 1e-3
    return 2.0 * float(context.network.radius.max())


def in_the_dish(context: RunContext, run: DryRun) -> list[Check]:
    """Walls and depth of the dish that the recipe names."""
    part = context.recipe.printer
    if context.dish is None:
        return [unknown_dish()]
    x, y, _ = context.start_mm.tolist()
    centre = part.dish_centre_mm or (x, y)
    standing = Standing(context.dish, centre, context.printer.z_mm.low, part.bath_depth_mm)
    return dish_checks(run, standing, context.needle)


def crossings(context: RunContext) -> list[Check]:
    """Passes of the needle through what is written; layers are written from below, without any."""
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        return []
    planned = context.manifest.stages["toolpath"].summary["plan"]
    return [crossings_check(len(planned["crossings"]), part.allowed_crossings)]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Run the file through the planner; refuse when anything is wrong."""
    x, y, z = context.start_mm.tolist()
    data = (context.folder / GCODE).read_bytes()
    run = dry_run(data, context.printer, (x, y, z))
    checks, reload_at = with_reloads(
        all_checks(context, run),
        parse_job(data, GCODE, context.printer.max_line_bytes),
        usable_mm(context.syringe, context.printer),
        wanted=context.recipe.printer.care.reload,
        by="say printer.care.reload: true",
    )
    care = context.recipe.printer.care
    time = PrintTime(run.duration_s, len(reload_at), care.reload_min)
    budget = budget_of(context.ink, care.viability_min, care.viability_source)
    checks += viability_checks(time, budget)
    ink = ink_use(
        run, context.printer, context.syringe, context.needle, context.flow_ul_s, len(reload_at)
    )
    summary = {
        "duration_s": run.duration_s,
        **viability_facts(time, budget),
        **ink.facts(),
        "merged_moves": run.merged_moves,
        "reload_at": list(reload_at),
        "checks": [check.as_dict() for check in checks],
    }
    write_text(context.folder / CHECKS, json.dumps(summary, indent=1) + "\n")
    refuse_failed(checks)
    for text in warnings(checks):
        context.bars.remark("dry run", text)
    return summary, [CHECKS]


STAGE = Stage("dry run", depends, (GCODE, NETWORK), ("kernels", "sim", "firmware_profiles"), work)
