"""Stage 7: what the G-code leaves open of each vessel; refuses closed and leaking lumens."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from design.files import write_text
from printctl.errors import SafetyError
from printctl.lumens import check_network, read_lines
from printctl.pipeline.context import NETWORK, RunContext
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.toolpath import GCODE
from printctl.progress import Report
from printctl.recipe.making import Fresh

LUMENS: Final = "lumens.json"
LEAK_MM: Final = 0.05
"""Ways out of a lumen that are narrower are closed by the ink's own spreading."""


def depends(context: RunContext) -> Any:
    """What the lines' widths and places follow from, besides the G-code."""
    return [
        context.recipe.toolpath.model_dump(mode="json"),
        context.syringe.model_dump(mode="json"),
        context.ink.flow_factor,
        context.printer.steps_per_mm.model_dump(mode="json"),
        context.place_mm.tolist(),
    ]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Hold the G-code against the network; refuse what is closed or leaks."""
    part = context.recipe.toolpath
    why = None
    if not isinstance(part, Fresh):
        why = "an embedded print writes its vessels and leaves no lumens open"
    elif context.printer.pneumatic is not None:
        why = "a valve writes, whose lines say nothing of their width"
    if why is not None or not isinstance(part, Fresh):
        return {"checked": False, "why": why}, []
    report(0.1, "reading the lines")
    area = np.pi / 4 * context.syringe.inner_mm**2 * context.ink.flow_factor
    gcode = (context.folder / GCODE).read_bytes()
    lines = read_lines(gcode, area, layer_mm=part.layer_um * 1e-3)
    report(0.3, "looking for leaks and measuring sections")
    steps = context.printer.steps_per_mm
    check = check_network(lines, context.network, context.place_mm, (steps.x, steps.y), LEAK_MM)
    found = {"checked": True, **check.as_dict()}
    write_text(context.folder / LUMENS, json.dumps(found, indent=1, allow_nan=False) + "\n")
    if check.refusal is not None:
        raise SafetyError(f"refused before the first byte was sent:\n{check.refusal}")
    for note in check.notes:
        context.bars.remark("lumens", note)
    return found, [LUMENS]


STAGE = Stage("lumens", depends, (GCODE, NETWORK), ("kernels", "sim"), work)
