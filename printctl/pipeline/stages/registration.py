"""Stage 9: segment the lumens, align the scan with the design, measure each vessel."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from design.files import write_text
from design.solids import Solid
from kernels.ahead import wait_for_late
from kernels.arrays import FloatArray
from printctl.pipeline.context import RunContext
from printctl.pipeline.judging.measurement_record import Corrections
from printctl.pipeline.judging.register_and_judge import ScannedDesign, register_and_judge
from printctl.pipeline.judging.tracing import Job, by_layer, made_by, read_job
from printctl.pipeline.judging.written_in_scan import WRITTEN, save_written, written_places
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.scan import TRUTH, digest_user_files, load_scan, scan_name
from printctl.progress import Report
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from printctl.recipe.sections.record import RecordPart
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP, LUMEN, NETWORK, NUMBERS, SOLID
from printctl.run_folder.registration_files import VIEWS
from registration import RegistrationOptions, RegistrationReport
from registration.measuring.geometry import check_designed, read_datums
from report.views import save_views


def pose_error(
    scan_to_part: FloatArray,
    truth_printer_to_scan: FloatArray,
    place: FloatArray,
    box: FloatArray,
    written: FloatArray | None = None,
) -> dict[str, float]:
    """Displacement of the part's corners by the error of the recovered transform.

    Parameters
    ----------
    scan_to_part : (4, 4)
        As registration found it, scales included.
    truth_printer_to_scan : (4, 4)
        As the scanner placed and shrank the part.
    place : (3,) mm
        Part to printer.
    box : (2, 3) mm
        The part's bounds; its eight corners are tried.
    written : (4, 4), optional
        Design to what was written, of a compensated print.

    Returns
    -------
    dict
        ``pose_error_um`` (largest), ``pose_error_mean_um``.
    """
    corners = np.array(
        [[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    made = corners if written is None else _apply(written, corners)
    scanned = _apply(truth_printer_to_scan, made + place)
    error = np.linalg.norm(_apply(scan_to_part, scanned) - corners, axis=1) * 1e3
    return {"pose_error_um": float(error.max()), "pose_error_mean_um": float(error.mean())}


def _apply(transform: FloatArray, points: FloatArray) -> FloatArray:
    return points @ transform[:3, :3].T + transform[:3, 3]


def depends(context: RunContext) -> Any:
    """Recipe values that a registration depends on; includes the user's scan, if named."""
    part = context.scan_part
    made = [
        context.recipe.toolpath.model_dump(mode="json"),
        context.recipe.flow.model_dump(mode="json"),
        context.outlets_digest,
        context.place_mm.tolist(),
        context.compensation_digest,
        context.recipe.registration.model_dump(mode="json"),
        *([] if context.recipe.observe is None else ["looks"]),
    ]
    if not isinstance(part, FileScan):
        return made
    return [part.model_dump(mode="json"), *digest_user_files(context.recipe_folder, part), made]


def work(context: RunContext, report: Report) -> tuple[dict[str, object], Sequence[str]]:
    """Register; trace what is off to what wrote it; hold a simulated scan against the truth."""
    tolerances = context.recipe.registration.all_tolerances()
    tolerances.check_network(context.network)
    fresh = isinstance(context.recipe.toolpath, Fresh)
    job = _written_job(context)
    # Where a print was observed, its looks are held against what the scan has of its lines.
    written = None if context.recipe.observe is None else written_places(job, fresh)
    options = _options(context, None if written is None else written.at_mm)
    design = ScannedDesign(
        context.solid if fresh else context.lumen,
        context.folder / NETWORK,
        context.network,
        cords=context.recipe.toolpath.written == "cords",
    )
    scan = load_scan(context)
    wait_for_late()
    record = _record(context.scan_part)
    judged = register_and_judge(scan, design, options, tolerances, record)
    report(0.8, "tracing")
    summary, found = judged.numbers, judged.found
    add_traces(summary, context, found, job)
    report(0.9, "writing")
    write_text(context.folder / NUMBERS, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    save_views(context.folder / VIEWS, judged.views())
    names = judged.write(context.folder)
    if written is not None and found.gel_at is not None:
        # What an embedded print writes is melted out: ink is where no gel is.
        ink = found.gel_at if fresh else 1.0 - found.gel_at
        save_written(context.folder / WRITTEN, written, ink)
        names = [*names, WRITTEN]
    if isinstance(context.scan_part, SimulatedScan):
        summary["truth_check"] = check_truth(context, found, design.surface)
    return summary, [NUMBERS, VIEWS, *names]


def _options(context: RunContext, places: FloatArray | None) -> RegistrationOptions:
    """What the recipe says of the scan and of what flows; where it is asked for gel."""
    flow, part = context.conditions, context.scan_part
    datums = read_datums(context.recipe.registration.datums)
    check_designed(datums, context.network)
    bright = isinstance(part, FileScan) and part.filled
    return RegistrationOptions(
        lumens="bright" if bright else "dark", flow=flow, datums=datums, places_mm=places
    )


def _record(part: FileScan | SimulatedScan) -> tuple[RecordPart, Corrections] | None:
    """What is stated of a measurement; None of a simulated scan."""
    if not isinstance(part, FileScan):
        return None
    return part.record or RecordPart(), Corrections(part.oct_calibration, part.air_above)


def _written_job(context: RunContext) -> Job:
    """The G-code's writing moves, back in the design's size, where the scan's findings are."""
    stretch = context.corrections.stretch
    job = read_job(
        context.folder / GCODE,
        context.folder / LINE_MAP,
        context.printer,
        context.start_mm,
        context.place_mm,
    )
    moves = replace(job.moves, start=stretch.back(job.moves.start), end=stretch.back(job.moves.end))
    return replace(job, moves=moves)


def add_traces(
    summary: dict[str, Any], context: RunContext, report: RegistrationReport, job: Job
) -> None:
    """Say of each layer how far off it is, and of each defect which lines wrote around it."""
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        line_mm = part.line_um * 1e-3
        summary["by_layer"] = by_layer(report, job)
    else:
        # A filament fills its own lumen: no line's width lies between.
        line_mm = 0.0
    for defect in summary["findings"]:
        defect["made_by"] = made_by(defect, job, context.local_network, line_mm)


def check_truth(context: RunContext, report: RegistrationReport, model: Solid) -> dict[str, float]:
    """The recovered transform against the simulated scanner's, which registration never saw."""
    truth = json.loads((context.folder / TRUTH).read_text(encoding="utf-8"))
    return pose_error(
        report.scaled_scan_to_part,
        np.array(truth["printer_to_scan"]),
        context.place_mm,
        model.bounds,
        context.corrections.stretch.matrix,
    )


def reads(context: RunContext) -> tuple[str, ...]:
    """The design, and the simulated scan where there is one."""
    part = context.scan_part
    scan = (scan_name(part), TRUTH) if isinstance(part, SimulatedScan) else ()
    return (NETWORK, LUMEN, SOLID, GCODE, LINE_MAP, *scan)


STAGE = Stage("registration", depends, reads, ("kernels", "registration", "design"), work)
