"""Stage 5: the needle's path, and the G-code for the profile's firmware."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from design.files import replacing, write_bytes
from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions, embedded_toolpath
from design.toolpath.fresh import FreshOptions, fresh_toolpath
from design.toolpath.gcode import Gcode, write_gcode
from printctl.pipeline.context import NETWORK, SOLID, RunContext
from printctl.pipeline.progress import Report
from printctl.pipeline.stage import Stage
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


def make_toolpath(context: RunContext) -> Toolpath:
    """Plan the path in the part's frame."""
    part, ink = context.recipe.toolpath, context.ink
    match part:
        case Fresh():
            return fresh_toolpath(
                context.solid,
                FreshOptions(
                    layer_height_mm=part.layer_um * 1e-3,
                    line_width_mm=part.line_um * 1e-3,
                    write_speed_mm_s=part.write_speed_mm_s,
                    travel_speed_mm_s=part.travel_speed_mm_s,
                    retract_ul=ink.retract_ul,
                    plunger_ul_s=ink.plunger_ul_s,
                ),
            )
        case Embedded():
            return embedded_toolpath(
                context.network,
                EmbeddedOptions(
                    needle_inner_mm=context.needle.inner_mm,
                    needle_outer_mm=context.needle.outer_mm,
                    write_speed_mm_s=part.write_speed_mm_s,
                    travel_speed_mm_s=part.travel_speed_mm_s,
                    retract_ul=ink.retract_ul,
                    plunger_ul_s=ink.plunger_ul_s,
                ),
            )


def write_line_map(context: RunContext, gcode: Gcode) -> None:
    """Keep which layer or vessel, and which move, each line of the G-code is for."""
    with replacing(context.folder / LINE_MAP) as draft, draft.open("wb") as handle:
        np.savez(
            handle,
            source=gcode.line_source,
            move=gcode.line_move,
            source_kind=np.array(gcode.source_kind),
        )


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Plan, write, map."""
    toolpath = make_toolpath(context)
    report(0.8, "writing G-code")
    gcode = write_gcode(
        toolpath, context.printer, context.syringe, context.place_mm, start_mm=context.start_mm
    )
    write_bytes(context.folder / GCODE, gcode.data)
    write_line_map(context, gcode)
    summary = {
        "method": context.recipe.toolpath.method,
        "moves": len(toolpath),
        "lines": len(gcode.line_source),
        "length_mm": float(toolpath.lengths.sum()),
        "written_ul": toolpath.written_ul,
    }
    return summary, [GCODE, LINE_MAP]


STAGE = Stage("toolpath", depends, (NETWORK, SOLID), ("kernels", "design"), work)
