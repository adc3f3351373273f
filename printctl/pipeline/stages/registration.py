"""Stage 9: segment the lumens, align the scan with the design, measure each vessel."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from design.files import write_text
from design.solids import Solid
from kernels.ahead import wait_for_late
from kernels.arrays import FloatArray
from printctl.pipeline.context import RunContext
from printctl.pipeline.judging.measurement_record import Corrections, add_record
from printctl.pipeline.judging.tracing import Job, by_layer, made_by, read_job
from printctl.pipeline.judging.written_in_scan import WRITTEN, save_written, written_places
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.scan import TRUTH, digest_user_files, load_scan, scan_name
from printctl.progress import Report
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from printctl.recipe.sections.record import RecordPart
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP, LUMEN, NETWORK, NUMBERS, SOLID
from printctl.run_folder.registration_files import (
    AS_CORDS,
    DEVIATION,
    VIEWS,
    design_facts,
    scan_facts,
    surface_facts,
    write_deviation,
    write_exports,
)
from registration import RegistrationOptions, RegistrationReport, register_scan, report_dict
from registration.devices.optics import is_resampled
from registration.measuring.geometry import check_designed, read_datums
from registration.measuring.judging import judge
from registration.result import SIGN
from report.views import add_scan_places, save_views, take_views

# Compute a registration's pose error against the simulated scanner's true pose.


def pose_error(
    scan_to_part: FloatArray,
    truth_printer_to_scan: FloatArray,
    place: FloatArray,
    box: FloatArray,
    written: FloatArray | None = None,
) -> dict[str, Any]:
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


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Register; trace what is off to what wrote it; hold a simulated scan against the truth."""
    tolerances = context.recipe.registration.all_tolerances()
    tolerances.check_network(context.network)
    fresh = isinstance(context.recipe.toolpath, Fresh)
    model = context.solid if fresh else context.lumen
    job = _written_job(context)
    # Where a print was observed, its looks are held against what the scan has of its lines.
    written = None if context.recipe.observe is None else written_places(job, fresh)
    options = _options(context)
    if written is not None:
        options = replace(options, places_mm=written.at_mm)
    scan = load_scan(context)
    wait_for_late()
    registered = register_scan(scan, model, context.network, options)
    report(0.8, "tracing")
    numbers = report_dict(registered)
    if context.recipe.toolpath.written == "cords":
        numbers |= AS_CORDS
    summary = {
        **judge(numbers, tolerances),
        "sign_convention": SIGN,
        "measured_by": scan_facts(scan),
        "by_surface": surface_facts(registered, context.network),
        "design": design_facts(context.folder / NETWORK),
    }
    part = context.scan_part
    if isinstance(part, FileScan):
        done = Corrections(part.oct_calibration, part.air_above)
        add_record(summary, part.record or RecordPart(), scan, done, datetime.now(UTC))
    add_scan_places(summary, scan, registered)
    add_traces(summary, context, registered, job)
    report(0.9, "writing")
    write_text(context.folder / NUMBERS, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    write_deviation(context.folder / DEVIATION, registered)
    views = take_views(scan, model, registered, summary, not is_resampled(scan))
    save_views(context.folder / VIEWS, views)
    names = write_exports(context.folder, scan, context.network, (registered, summary))
    if written is not None and registered.gel_at is not None:
        # What an embedded print writes is melted out: ink is where no gel is.
        ink = registered.gel_at if fresh else 1.0 - registered.gel_at
        save_written(context.folder / WRITTEN, written, ink)
        names = [*names, WRITTEN]
    if isinstance(context.scan_part, SimulatedScan):
        summary["truth_check"] = check_truth(context, registered, model)
    return summary, [NUMBERS, DEVIATION, VIEWS, *names]


def _options(context: RunContext) -> RegistrationOptions:
    """What the recipe says of the scan and of what flows."""
    flow, part = context.conditions, context.scan_part
    datums = read_datums(context.recipe.registration.datums)
    check_designed(datums, context.network)
    bright = isinstance(part, FileScan) and part.filled
    # A cord is bright, and so is a lumen that is filled: both are solid in the scan.
    bright |= context.recipe.toolpath.written == "cords"
    return RegistrationOptions(lumens="bright" if bright else "dark", flow=flow, datums=datums)


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


def check_truth(context: RunContext, report: RegistrationReport, model: Solid) -> dict[str, Any]:
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
