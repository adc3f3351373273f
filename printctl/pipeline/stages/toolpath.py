"""Stage 5: the needle's path, and the G-code for the profile's firmware."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from design.files import replacing, write_bytes
from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions, EmbeddedReport, plan_embedded
from design.toolpath.fresh import Compensation, FreshOptions, FreshReport, check_lumens, plan_fresh
from design.toolpath.gcode import Gcode, GcodeOptions, clear_mm, least_move_mm, write_gcode
from firmware_profiles import Ink
from printctl.pipeline.context import NETWORK, SOLID, RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.making import Embedded, Fresh

GCODE, LINE_MAP = "part.gcode", "part.map.npz"


def depends(context: RunContext) -> Any:
    """The section and every profile that shapes the path."""
    profiles = (context.printer, context.needle, context.syringe, context.ink, context.bath)
    return [
        context.recipe.toolpath.model_dump(mode="json"),
        [profile.model_dump(mode="json") for profile in profiles],
        context.place_mm.tolist(),
    ]


def plan(context: RunContext) -> tuple[Toolpath, FreshReport | EmbeddedReport]:
    """Plan the path in the part's frame, and say how well it went."""
    part, ink = context.recipe.toolpath, context.ink
    match part:
        case Fresh():
            options = FreshOptions(
                layer_height_mm=part.layer_um * 1e-3,
                line_width_mm=part.line_um * 1e-3,
                walls=part.walls,
                infill=part.infill,
                infill_density=part.infill_percent * 1e-2,
                infill_angles_deg=part.infill_angles_deg,
                least_move_mm=least_move_mm(context.printer),
                clear_mm=clear_mm(context.printer),
                compensation=Compensation(
                    part.compensate.shrink_percent, part.compensate.radial_um * 1e-3
                ),
                write_speed_mm_s=part.write_speed_mm_s,
                travel_speed_mm_s=part.travel_speed_mm_s,
                retract_ul=ink.retract_ul,
                plunger_ul_s=ink.plunger_ul_s,
            )
            check_lumens(context.network, options)
            fresh = plan_fresh(context.solid, options)
            return fresh.toolpath, fresh.report
        case Embedded():
            embedded = plan_embedded(
                context.network,
                EmbeddedOptions(
                    needle_inner_mm=context.needle.inner_mm,
                    needle_outer_mm=context.needle.outer_mm,
                    write_speed_mm_s=part.write_speed_mm_s,
                    travel_speed_mm_s=part.travel_speed_mm_s,
                    overlap_radii=part.overlap_radii,
                    retract_ul=ink.retract_ul,
                    plunger_ul_s=ink.plunger_ul_s,
                ),
            )
            return embedded.toolpath, embedded.report


def gcode_options(
    ink: Ink,
    start_mm: tuple[float, float, float],
    travel_speed_mm_s: float,
    flow_ul_s: float | None,
) -> GcodeOptions:
    """The writer's choices for an ink; ``flow_ul_s`` is a pneumatic head's, else None."""
    span = ink.write_speed_mm_s
    return GcodeOptions(
        start_mm=start_mm,
        travel_speed_mm_s=travel_speed_mm_s,
        relieve_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s,
        flow_factor=ink.flow_factor,
        flow_ul_s=flow_ul_s,
        ink_speed_mm_s=None if span is None else (span.low, span.high),
    )


def save_line_map(path: Path, gcode: Gcode) -> None:
    """Keep which layer or vessel, and which move, each line of the G-code is for."""
    with replacing(path) as draft, draft.open("wb") as handle:
        np.savez(
            handle,
            source=gcode.line_source,
            move=gcode.line_move,
            source_kind=np.array(gcode.source_kind),
        )


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Plan, write, map."""
    toolpath, planned = plan(context)
    report(0.8, "writing G-code")
    x, y, z = context.start_mm.tolist()
    travel = context.recipe.toolpath.travel_speed_mm_s
    options = gcode_options(context.ink, (x, y, z), travel, context.flow_ul_s)
    gcode = write_gcode(toolpath, context.printer, context.syringe, context.place_mm, options)
    write_bytes(context.folder / GCODE, gcode.data)
    save_line_map(context.folder / LINE_MAP, gcode)
    summary = {
        "method": context.recipe.toolpath.method,
        "moves": len(toolpath),
        "lines": gcode.line_count,
        "length_mm": float(toolpath.lengths.sum()),
        "written_ul": toolpath.written_ul,
        "plan": plan_facts(planned),
    }
    return summary, [GCODE, LINE_MAP]


def plan_facts(planned: FreshReport | EmbeddedReport) -> dict[str, Any]:
    """The plan's own numbers, JSON-ready."""
    found = asdict(planned)
    if isinstance(planned, FreshReport):
        found |= {"unfilled": planned.unfilled_fraction, "outside": float(planned.outside.mean())}
    return found


STAGE = Stage("toolpath", depends, (NETWORK, SOLID), ("kernels", "design"), work)
