"""Stage 10: write the report (HTML, JSON, on request PDF) and the deviation surface (PLY)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from design.files import write_text
from printctl.analysis.flow import WAVES, read_waves
from printctl.analysis.flow.fidelities import COMPARED, SEEN
from printctl.analysis.flow.lattice_comparison import PICTURE
from printctl.analysis.oxygen import CAPTION, SLICE
from printctl.checks.bead import PLAYED
from printctl.machine.job.job import load_job
from printctl.machine.records.folders import print_identity
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.observe.records import read_looks
from printctl.pipeline.context import RunContext
from printctl.pipeline.job.layer_pictures import layer_pictures
from printctl.pipeline.judging.look_pictures import look_pictures
from printctl.pipeline.judging.verdict import verdict
from printctl.pipeline.judging.written_in_scan import WRITTEN, looks_and_scan
from printctl.pipeline.prepared.written_layers import outlined_design, pushing_of
from printctl.pipeline.stages.collect import collect
from printctl.run_folder.artefacts import GCODE, HTML, JOURNAL_FOLDER, JSON, PDF
from printctl.run_folder.manifest import digest_file
from printctl.run_folder.registration_files import DEVIATION, VIEWS, load_deviation
from report import ReportSurface, write_report_html
from report.deviation_surfaces import split_surfaces
from report.figures.flow_figures import wave_figure
from report.play import load_played, play_section
from report.print_page import print_page
from report.views import load_views


def frames(context: RunContext, registration: dict[str, Any]) -> dict[str, Any]:
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


def write_report(context: RunContext, pdf: bool = False) -> dict[str, Any]:
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
    drawn, views = figures(context, scan_rows), load_views(context.folder / VIEWS)
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


def figures(context: RunContext, scan_rows: Sequence[dict[str, Any]] = ()) -> dict[str, bytes]:
    """Layers or passes, looks at the print; the other figures the page draws by itself."""
    return (
        waves(context)
        | space_pictures(context)
        | oxygen_picture(context)
        | layer_pictures(context.folder / GCODE, pushing_of(context), outlined_design(context))
        | observed(context, scan_rows)
    )


def observed(context: RunContext, scan_rows: Sequence[dict[str, Any]] = ()) -> dict[str, bytes]:
    """Looks at the print, where the recipe has it observed."""
    if context.recipe.observe is None:
        return {}
    return look_pictures(context.folder / JOURNAL_FOLDER, scan_rows)


def look_rows_with_scan(context: RunContext) -> list[dict[str, Any]]:
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


def space_pictures(context: RunContext) -> dict[str, bytes]:
    """Wall shear in the lumens and fidelities side by side, where the recipe asks for them."""
    asked, pictures = context.recipe.flow, {}
    if asked.three_d is not None:
        pictures["fidelities/Wall shear, resolved in the lumens"] = SEEN
    compare = asked.compare
    if compare is not None and (asked.three_d is not None or asked.one_d is not None):
        pictures["fidelities/Fidelities against the ideal"] = COMPARED
    if compare is not None and compare.lattice is not None:
        pictures["fidelities/Flow across the vessels that feed, and across a lattice's"] = PICTURE
    return {caption: (context.folder / name).read_bytes() for caption, name in pictures.items()}


def oxygen_picture(context: RunContext) -> dict[str, bytes]:
    """The section through the worst place, where the recipe asks for oxygen."""
    if context.recipe.oxygen is None:
        return {}
    return {f"oxygen/{CAPTION}": (context.folder / SLICE).read_bytes()}


def waves(context: RunContext) -> dict[str, bytes]:
    """Flow and pressure at the ends over a cycle, where the recipe's flow pulses."""
    if context.recipe.flow.pulse is None:
        return {}
    caption = "flow/Flow and pressure at inlets and outlets over one cycle, as designed"
    return {caption: wave_figure(read_waves(context.folder / WAVES))}
