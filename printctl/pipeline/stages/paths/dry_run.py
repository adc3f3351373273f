"""Stage 6: simulate the G-code and refuse to go on when a check fails."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from design.files import write_text
from firmware_profiles import Printer
from gcode.clearance.check import Clearance
from gcode.dry_run.run import DryRun, dry_run
from printctl.checks.bead import PLAYED
from printctl.checks.preflight import (
    Check,
    PlacedDish,
    accepted_text,
    bath_checks,
    check_each_head,
    chemistry_check,
    dish_checks,
    floor_check,
    force_checks,
    gcode_checks,
    head_checks,
    held_check,
    ink_use,
    needle_check,
    placed_failures,
    read_written,
    refuse_failed,
    role_checks,
    shaft_checks,
    shaft_clearance,
    step_checks,
    syringe_checks,
    temperature_checks,
    unknown_dish,
    warnings,
    written_ul,
)
from printctl.checks.preflight.bore import line_checks
from printctl.machine.job.job import parse_job
from printctl.machine.job.syringes import usable_mm
from printctl.machine.ports.detection import SIMULATED
from printctl.pipeline.context import RunContext
from printctl.pipeline.job.heads import layer_lines_um
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths.predicting import predicting
from printctl.pipeline.stages.paths.toolpath import of_heads
from printctl.pipeline.syringe_plan import plan_syringes
from printctl.progress import Report
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK

CHECKS = "dry_run.json"


def depends(context: RunContext) -> Any:
    """Everything that a check looks at, besides the G-code."""
    profiles = (context.printer, context.needle, context.syringe, context.ink, context.bath)
    part, at = context.recipe.toolpath.model_dump(mode="json"), context.recipe.printer
    return [
        part,
        [profile.model_dump(mode="json") for profile in profiles],
        *of_heads(context),
        context.start_mm.tolist(),
        context.place_mm.tolist(),
        context.dish and context.dish.model_dump(mode="json"),
        at.port == SIMULATED,
        [at.dish_centre_mm, context.bath_depth_mm, at.care.reload],
        [at.care.reload_min, at.care.viability_min, at.care.viability_source],
        context.compensation_digest,
        PLAYED,  # a run folder from before it gets one
    ]


def all_checks(context: RunContext, run: DryRun) -> list[Check]:
    """The G-code's own checks and those of the set-up."""
    printer, dish = context.printer, standing(context)
    ink_ul = written_ul(run, printer, context.loads)
    inks = [one.ink for one in context.loads]
    common = [
        *bath_checks(context.bath),
        *role_checks(inks, context.bath, context.recipe.toolpath.written),
        *([] if dish else [unknown_dish(real=context.recipe.printer.port != SIMULATED)]),
    ]
    if not printer.heads:
        return [*gcode_checks(run, printer), *of_head(context, run, printer, 0, ink_ul), *common]
    needles = [one.needle for one in context.loads]
    return [
        *gcode_checks(run, printer),
        *check_each_head(run, printer, lambda k, view, one: of_head(context, view, one, k, ink_ul)),
        *head_checks(run, printer, dish, needles),
        *common,
    ]


def of_head(
    context: RunContext, run: DryRun, printer: Printer, number: int, ink_ul: float
) -> list[Check]:
    """What a head holds and where its needle goes; the printer has that head alone.

    ``ink_ul`` is what all heads together write.
    """
    needle, dish = context.loads[number].needle, standing(context)
    checks = [*of_mounted(context, run, printer, number), *of_part(context, number)]
    return checks if dish is None else [*checks, *dish_checks(run, dish, needle, ink_ul)]


def of_mounted(context: RunContext, run: DryRun, printer: Printer, number: int) -> list[Check]:
    """What a head holds, whatever it writes; the printer has that head alone."""
    load, bath, part = context.loads[number], context.bath, context.recipe.toolpath
    return [
        *syringe_checks(run, printer, load.syringe),
        *step_checks(run, printer, load.syringe),
        *force_checks(run, load.ink, load.needle, load.syringe, printer),
        *line_checks(run, printer, context.loads[number], part.thinnest_bore, part.style[0]),
        chemistry_check(load.ink, bath),
        *temperature_checks(run, load.ink, bath),
        floor_check(run, bath, printer.z_mm.low),
    ]


def of_part(context: RunContext, number: int) -> list[Check]:
    """What the part asks of a head's needle and of the bath."""
    low, high = context.written_bounds
    load = context.loads[number]
    return [
        needle_check(float(high[2] - low[2]), load.needle),
        held_check(widest_filament_mm(context, number), load.ink, context.bath),
    ]


def widest_filament_mm(context: RunContext, number: int = 0) -> float:
    """Thickest filament that a head writes: a vessel, or in layers a line."""
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        heads = context.recipe.printer.heads
        return layer_lines_um(part, heads, context.printer.head_count)[number] * 1e-3
    own = np.repeat(context.vessel_head == number, np.diff(context.network.offset))
    return 2.0 * float(context.written_network.radius[own].max(initial=0.0))


def standing(context: RunContext) -> PlacedDish | None:
    """The dish that the recipe names, where it stands."""
    part = context.recipe.printer
    if context.dish is None:
        return None
    x, y, _ = context.start_mm.tolist()
    centre = part.dish_centre_mm or (x, y)
    key = "printer.bath_depth_mm" if context.stand is None else "plate.bath_depth_mm"
    floor = context.printer.z_mm.low
    return PlacedDish(context.dish, centre, floor, context.bath_depth_mm, key)


def shaft(context: RunContext, run: DryRun) -> Clearance | None:
    """The needle's shaft against what is written; layers are written from below, without any."""
    written = read_written(context.folder / LINE_MAP)
    if written is None or isinstance(context.recipe.toolpath, Fresh):
        return None
    return shaft_clearance(run, context.printer, context.loads, written)


def allowed_shaft(context: RunContext, clearance: Clearance | None) -> list[Check]:
    """What the recipe allows of it."""
    part = context.recipe.toolpath
    if clearance is None or isinstance(part, Fresh):
        return []
    return shaft_checks(clearance, part.allowed_crossings)


def shaft_facts(clearance: Clearance | None) -> dict[str, Any]:
    """The checker's result, JSON-ready; nothing for layers."""
    if clearance is None:
        return {}
    return {"clearance": clearance.as_dict(), "accepted_crossings": accepted_text(clearance)}


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Run the file through the planner; refuse when anything is wrong."""
    x, y, z = context.start_mm.tolist()
    data = (context.folder / GCODE).read_bytes()
    run = dry_run(data, context.printer, (x, y, z))
    machines = [context.printer.of_head(k) for k in range(context.printer.head_count)]
    planned = plan_syringes(
        all_checks(context, run),
        parse_job(data, GCODE, context.printer),
        [usable_mm(one.syringe, of) for one, of in zip(context.loads, machines, strict=True)],
        [one.ink for one in context.loads],
        run.duration_s,
        context.recipe.printer.care,
        by="say printer.care.reload: true",
    )
    clearance = shaft(context, run)
    checks = [*planned.checks, *allowed_shaft(context, clearance)]
    summary = {
        "duration_s": run.duration_s,
        **planned.facts,
        **ink_facts(context, run, planned.reload_at, planned.reload_heads),
        **shaft_facts(clearance),
        "merged_moves": run.merged_moves,
        "checks": [check.as_dict() for check in checks],
    }
    report(0.5, "predicting what will lie in the bath")
    predicted, files = predicting(context, run, data, placed_failures(checks))
    facts = summary | {"predicted": predicted}
    write_text(context.folder / CHECKS, json.dumps(facts, indent=1) + "\n")
    refuse_failed(checks)
    for text in warnings(checks):
        context.bars.remark("dry run", text)
    return summary, [CHECKS, *files]


def ink_facts(
    context: RunContext, run: DryRun, reload_at: Sequence[int], reload_heads: Sequence[int]
) -> dict[str, Any]:
    """Ink that is taken; of several heads of each, and of all together."""
    printer, flow = context.printer, context.flow_ul_s
    flows = context.flows_ul_s or (None,) * printer.head_count
    if not printer.heads:
        load, count = context.loads[0], len(reload_at)
        return ink_use(run, printer, load.syringe, load.needle, flow, count).facts()
    each = [
        ink_use(
            run.of_head(number),
            printer.of_head(number),
            load.syringe,
            load.needle,
            flows[number],
            list(reload_heads).count(number),
        ).facts()
        for number, load in enumerate(context.loads)
    ]
    whole = {key: round(sum(one[key] for one in each), 3) for key in each[0]}
    whole["ink_left_per_filling_ul"] = max(one["ink_left_per_filling_ul"] for one in each)
    return {**whole, "ink_of_heads": each}


STAGE = Stage(
    "dry run",
    depends,
    (GCODE, LINE_MAP, NETWORK),
    ("kernels", "gcode", "sim", "firmware_profiles"),
    work,
)
