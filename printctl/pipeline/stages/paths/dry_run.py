"""Stage 6: simulate the G-code and refuse to go on when a check fails."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from design.files import write_text
from gcode.dry_run.run import DryRun
from printctl.checks.bead import PLAYED
from printctl.checks.preflight import (
    Designed,
    HeadLoading,
    PlacedDish,
    SetUp,
    accepted_text,
    ink_use,
    placed_failures,
    refuse_failed,
    warnings,
)
from printctl.checks.set_up import NONE, RECIPE_KEYS, options_of
from printctl.machine.ports.detection import SIMULATED
from printctl.pipeline.checked_order import CheckedOrder, OrderCare, checked_order
from printctl.pipeline.context import RunContext
from printctl.pipeline.job.heads import layer_lines_um
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths.predicting import predicting
from printctl.pipeline.stages.paths.toolpath import of_heads
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
        *(PLAYED, "lift_mm"),  # a run folder from before them gets them
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


def designed(context: RunContext) -> Designed:
    """What the recipe knows of the part, besides its G-code."""
    low, high = context.written_bounds
    widest = [widest_filament_mm(context, number) for number in range(context.printer.head_count)]
    return Designed(float(high[2] - low[2]), widest, context.recipe.toolpath.written)


def set_up_of(context: RunContext) -> SetUp:
    """What the recipe says is mounted; of a plate's own run no dish."""
    recipe, loads = context.recipe, context.loads
    x, y, z = context.start_mm.tolist()
    of_plate = recipe.plate is not None
    held = tuple(HeadLoading(one.syringe, one.ink, one.needle) for one in loads)
    part, needle = recipe.printer, recipe.toolpath.needle
    each = part.heads or (part,)
    names = {
        "syringe": ",".join(one.syringe for one in each),
        "ink": ",".join(one.ink for one in each),
        "needle": ",".join(getattr(one, "needle", None) or needle for one in each),
        "bath": part.bath,
        "dish": NONE if of_plate else part.dish or "",
    }
    centre = part.dish_centre_mm
    lengths = {
        "dish_centre": None if centre is None else ",".join(f"{mm:g}" for mm in centre),
        "bath_depth": part.bath_depth_mm,
    }
    return SetUp(
        context.printer,
        *(held[0].syringe, held[0].ink, held[0].needle),
        context.bath,
        None if of_plate else standing(context),
        held if context.printer.heads else (),
        recipe.toolpath.thinnest_bore,
        ("dish",) if of_plate else (),
        (x, y, z),
        names,
        options_of({**names, "dish": part.dish, **lengths}),
        RECIPE_KEYS,
    )


def checked(
    context: RunContext, of_part: Designed | None = None, allowed_crossings: int | None = None
) -> CheckedOrder:
    """Check the G-code in a run's folder; of a plate ``of_part`` and crossings are its wells'."""
    part = context.recipe.toolpath
    if allowed_crossings is None:
        allowed_crossings = 0 if isinstance(part, Fresh) else part.allowed_crossings
    care = OrderCare(
        context.recipe.printer.care,
        context.recipe.printer.port != SIMULATED,
        allowed_crossings,
        designed=of_part or designed(context),
    )
    return checked_order(context.folder / GCODE, set_up_of(context), care)


def summary_of(context: RunContext, found: CheckedOrder) -> dict[str, Any]:
    """What the run's manifest keeps of the checks."""
    shaft, plan = found.shaft.found, found.plan
    return {
        **found.facts,
        **plan.to_dict(),
        **ink_facts(context, found.run, plan.reload_at, plan.reload_heads),
        **({} if shaft is None else {"clearance": shaft.as_dict()}),
        **({} if shaft is None else {"accepted_crossings": accepted_text(shaft)}),
        "merged_moves": found.run.merged_moves,
        "checks": [check.as_dict() for check in found.checks],
    }


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Run the file through the planner; refuse when anything is wrong."""
    found = checked(context)
    summary = summary_of(context, found)
    report(0.5, "predicting what will lie in the bath")
    predicted, files = predicting(context, found.run, found.data, placed_failures(found.checks))
    facts = summary | {"predicted": predicted}
    write_text(context.folder / CHECKS, json.dumps(facts, indent=1) + "\n")
    refuse_failed(found.checks)
    for text in warnings(found.checks):
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
