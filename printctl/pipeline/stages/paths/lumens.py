"""Stage 6b: check in the G-code that each vessel is open and leak-free.

A compensated print is held against the network as it is to be written, since that is what its lines
should leave open; the scan will be held against the design.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from design.files import write_text
from firmware_profiles import Ink, Syringe
from gcode.deposit.written import Strands
from gcode.dry_run.run import dry_run
from printctl.checks.bead import written_filaments
from printctl.checks.lumens import (
    FilamentCheck,
    LumenCheck,
    Writing,
    check_filaments,
    check_network,
    list_names,
    read_filaments,
    read_layers,
)
from printctl.errors import SafetyError
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths.predicting import compensates, predicted_of_motion
from printctl.pipeline.stages.paths.replanning import explained, quiet
from printctl.pipeline.stages.paths.toolpath import of_heads, plain_job
from printctl.progress import Report
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK

LUMENS: Final = "lumens.json"
LEAK_MM: Final = 0.05
"""Ways out of a lumen that are narrower are closed by the ink's own spreading."""


def depends(context: RunContext) -> Any:
    """Recipe values that the lines' widths and places depend on, besides the G-code."""
    return [
        context.recipe.toolpath.model_dump(mode="json"),
        context.syringe.model_dump(mode="json"),
        context.ink.model_dump(mode="json") if compensates(context) else context.ink.flow_factor,
        context.flow_ul_s,
        context.ink.smallest_gap_mm,
        context.ink.bead,
        context.printer.model_dump(mode="json"),
        context.place_mm.tolist(),
        context.start_mm.tolist(),
        *of_heads(context),
        context.compensation_digest,
    ]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Hold the G-code against the network; refuse what is closed or leaks."""
    check = hold(context, report)
    if isinstance(check, LumenCheck) and check.refusal is not None:
        check = explained(context, check, lambda changed: hold(changed, quiet).refusal is None)
    facts = {"checked": True, **check.as_dict()}
    notes = [*check.notes, *gap_notes(context), *left_out_notes(_plan(context))]
    facts["notes"] = notes
    write_text(context.folder / LUMENS, json.dumps(facts, indent=1, allow_nan=False) + "\n")
    if check.refusal is not None:
        raise SafetyError(f"refused before the first byte was sent:\n{check.refusal}")
    for note in notes:
        context.bars.remark("lumens", note)
    return facts, [LUMENS]


def gap_notes(context: RunContext) -> list[str]:
    """Whether the thinnest lumen is one that this ink's lines leave open, where that was measured.

    Only between lines of layers: an embedded vessel is written itself.
    """
    least = context.ink.smallest_gap_mm
    if least is None or not isinstance(context.recipe.toolpath, Fresh):
        return []
    thinnest = 2 * float(context.written_network.radius.min())
    if thinnest >= least:
        return []
    return [
        f"the thinnest lumen is {thinnest:.3g} mm wide, and the smallest gap that "
        f"{context.ink.name} leaves open is {least:g} mm (ink: smallest_gap_mm): it may "
        "close; widen it, or take a thinner needle and measure it anew (printctl calibrate pattern "
        "comb)"
    ]


def hold(context: RunContext, report: Report) -> LumenCheck | FilamentCheck:
    """Read what is written, whatever head writes it, and hold it against the network."""
    gcode = (context.folder / GCODE).read_bytes()
    part, writing = context.recipe.toolpath, writing_of(context)
    report(0.1, "reading what is written")
    if isinstance(part, Fresh):
        lines, stepped = read_layers(gcode, writing)
        report(0.3, "looking for leaks and measuring sections")
        return check_network(lines, context.written_network, context.place_mm, stepped, LEAK_MM)
    ideal, after = _filaments(context, gcode, writing)
    report(0.3, "measuring filaments along the vessels")
    left_out = frozenset(int(one["vessel"]) for one in _plan(context).get("left_out", ()))
    return check_filaments(
        ideal, after, context.written_network, context.place_mm, LEAK_MM, left_out
    )


def _plan(context: RunContext) -> Mapping[str, Any]:
    """What the toolpath stage says of its plan."""
    record = context.manifest.stages.get("toolpath")
    return {} if record is None else record.summary.get("plan", {})


def left_out_notes(plan: Mapping[str, Any]) -> list[str]:
    """Which vessels `toolpath.leave_out` left unwritten, where, and what they alone supply."""
    left, cut = plan.get("left_out", ()), [str(vessel) for vessel in plan.get("cut_off", ())]
    if not left:
        return []
    named = [
        "vessel {} (too near to vessel {} at ({:.2f}, {:.2f}, {:.2f}) mm)".format(
            one["vessel"], one["other"], *one["place_mm"]
        )
        for one in left
    ]
    lost = f"; written, but without supply: {list_names(cut)}" if cut else ""
    return [
        f"not written, as toolpath.leave_out allows: {list_names(named)}{lost}; the print isn't "
        "the design, and its scan will show these vessels missing; move them apart or take a "
        "thinner needle (manifest.json, plan.left_out, names all with distances)"
    ]


def _filaments(context: RunContext, gcode: bytes, writing: Writing) -> tuple[Strands, Strands]:
    """As the file says and as motors do it; of a compensated job as planned and as predicted."""
    if not compensates(context):
        return read_filaments(gcode, writing)
    ideal, _ = read_filaments(plain_job(context).data, writing)
    run = dry_run(gcode, context.printer, writing.start_mm or (0.0, 0.0, 0.0))
    return ideal, written_filaments([predicted_of_motion(context, run, gcode).bead])


def writing_of(context: RunContext) -> Writing:
    """How the recipe's heads make ink of the file's moves."""
    x, y, z = context.start_mm.tolist()
    part, printer = context.recipe.toolpath, context.printer
    loads = context.loads if printer.heads else ()
    return Writing(
        printer=printer,
        ul_per_e=None if printer.pneumatic else _ul_per_mm(context.syringe, context.ink),
        flow_ul_s=context.flow_ul_s,
        layer_mm=part.even_layer_mm if isinstance(part, Fresh) else None,
        start_mm=(x, y, z),
        ul_per_e_of_heads=tuple(_ul_per_mm(one.syringe, one.ink) for one in loads),
        flow_ul_s_of_heads=context.flows_ul_s if loads else (),
        beads=tuple(one.ink.bead_section for one in loads) or (context.ink.bead_section,),
    )


def _ul_per_mm(syringe: Syringe, ink: Ink) -> float:
    """What a millimetre of the plunger lays, µL."""
    return float(np.pi / 4 * syringe.inner_mm**2 * ink.flow_factor)


STAGE = Stage(
    "lumens",
    depends,
    (GCODE, LINE_MAP, NETWORK),
    ("kernels", "gcode", "sim", "printctl/checks/lumens", "firmware_profiles"),
    work,
)
