"""Stage 10: write the report (HTML, JSON, on request PDF) and the deviation surface (PLY)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from design.files import write_text
from printctl.analysis.flow import WAVES, read_waves
from printctl.analysis.flow.fidelities import COMPARED, SEEN
from printctl.analysis.flow.lattice_comparison import PICTURE
from printctl.analysis.oxygen import SLICE
from printctl.checks.bead import PLAYED
from printctl.checks.gcode_view import read_job, read_line_map
from printctl.checks.gcode_view.outline import PartOutlines
from printctl.machine.job.job import load_job
from printctl.machine.records.folders import print_identity
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.observe.records import read_looks
from printctl.pipeline.context import RunContext
from printctl.pipeline.judging.look_rows import look_rows
from printctl.pipeline.judging.verdict import verdict
from printctl.pipeline.judging.written_in_scan import WRITTEN, looks_and_scan
from printctl.pipeline.prepared.written_layers import outlined_design, pushing_of
from printctl.pipeline.stages.collect import collect
from printctl.run_folder.artefacts import GCODE, HTML, JOURNAL_FOLDER, JSON, PDF
from printctl.run_folder.manifest import digest_file
from printctl.run_folder.registration_files import DEVIATION, VIEWS, load_deviation
from report import ReportSurface, write_report_html
from report.deviation_surfaces import split_surfaces
from report.figures.report_figures import RunSources, run_figures
from report.play import load_played, play_section
from report.print_page import print_page
from report.views import load_views


def frames(context: RunContext, registration: dict[str, object]) -> dict[str, object]:
    """The chain tissue → part → printer, and scan → part as registration found it."""
    place = np.eye(4)
    place[:3, 3] = context.place_mm
    return {
        "tissue_to_part": np.diag([*[context.recipe.print_scale] * 3, 1.0]).tolist(),
        "part_to_printer": place.tolist(),
        "scan_to_part": registration["transform_scan_to_part"],
        "unit": "mm",
        "handedness": "right",
    }


def write_report(context: RunContext, pdf: bool = False) -> dict[str, object]:
    """Write the report of a whole run, with `pdf` as a PDF too; return report.json's content."""
    data = collect(context)
    registration = data["registration"]
    truth = registration.pop("truth_check", None)
    if truth is not None:
        data["truth_check"] = truth
    data["verdict"] = verdict(registration)
    data["frames"] = frames(context, registration)
    scan_rows = look_rows_with_scan(context)
    if scan_rows:
        data["looks"] = scan_rows
    context.manifest.facts["frames"] = data["frames"]
    context.manifest.save()
    write_text(context.folder / JSON, json.dumps(data, indent=1, allow_nan=False) + "\n")
    drawn = run_figures(figure_sources(context, scan_rows))
    views = load_views(context.folder / VIEWS)
    play = context.folder / PLAYED
    shown = play_section(load_played(play)) if play.is_file() else None
    page = context.folder / HTML
    whole = {**data, "printed": print_identity(context.folder / JOURNAL_FOLDER)}
    write_report_html(page, whole, surfaces(context), context.network, drawn, shown, views)
    if pdf:
        print_page(page, context.folder / PDF)
    files = {name: digest_file(context.folder / name) for name in (JSON, HTML, *[PDF] * pdf)}
    printed = whole["printed"] or {}
    context.manifest.report = {"print": printed.get("id"), "files": files}
    context.manifest.save()
    return data


def surfaces(context: RunContext) -> list[ReportSurface]:
    """What the 3D view shows: the scanned surface with its deviation, and the design."""
    vertices, faces, deviation_um = load_deviation(context.folder / DEVIATION)
    solid = context.solid
    return [
        *split_surfaces(vertices, faces, deviation_um, context.network),
        ReportSurface("Construct, as designed", solid),
    ]


def figure_sources(context: RunContext, scan_rows: Sequence[Mapping[str, Any]] = ()) -> RunSources:
    """What the run's files hold for figures; the page draws others from report.json's numbers."""
    flow, folder = context.recipe.flow, context.folder
    gcode = (folder / GCODE).read_bytes()
    line_map, _ = read_line_map(folder / GCODE, gcode.count(b"\n"))
    job = read_job(gcode, GCODE, pushing_of(context), line_map)
    design = outlined_design(context)
    compare, resolved = flow.compare, flow.three_d is not None
    asked = {
        "shear": (resolved, SEEN),
        "compared": (compare is not None and (resolved or flow.one_d is not None), COMPARED),
        "beside": (compare is not None and compare.lattice is not None, PICTURE),
        "oxygen": (context.recipe.oxygen is not None, SLICE),
    }
    observed = context.recipe.observe is not None
    return RunSources(
        read_waves(folder / WAVES) if flow.pulse is not None else None,
        {key: folder / name for key, (wanted, name) in asked.items() if wanted},
        job,
        None if design is None else PartOutlines(job, *design).at,
        look_rows(folder / JOURNAL_FOLDER, scan_rows) if observed else (),
    )


def look_rows_with_scan(context: RunContext) -> list[dict[str, object]]:
    """Looks at the print beside what the final scan has there; none where nobody looked."""
    part, written = context.recipe.observe, context.folder / WRITTEN
    if part is None or not written.is_file():
        return []
    folder = context.folder / JOURNAL_FOLDER
    looks = read_looks(folder, read_journal_if_any(folder / JOURNAL).started)
    job = load_job(context.folder / GCODE, context.printer)
    lines = [job.file_line(one.job_line) for one in looks]
    inserts = read_journal(folder / JOURNAL).inserts
    return looks_and_scan(written, looks, inserts, lines, part.tolerance.gap_mm)
