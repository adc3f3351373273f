"""Write the HTML page that shows a run's G-code by layers or, embedded, by strokes."""

from __future__ import annotations

from pathlib import Path

from firmware_profiles import Ink, Printer, Syringe, load
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.errors import UsageError
from printctl.pipeline.written_layers import run_outlines
from printctl.run_folder.artefacts import GCODE
from printctl.run_folder.manifest import Manifest
from registration.report.gcode import GcodePage, write_gcode_html
from registration.report.gcode.colouring import PLAIN, colourings


def write_gcode(run: Path, path: Path) -> None:
    """Write the page of a run's layers or passes."""
    data = (run / GCODE).read_bytes()
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    line_map, _ = read_line_map(run / GCODE, lines)
    job = read_job(data, f"{run.name}/{GCODE}", _pushing(run), line_map)
    count = len(job.layers)
    first = count - 1 if job.layers.passes else (count - 1) // 2
    outlines = run_outlines(run, job)
    colour = colourings(job)[0] if outlines is None else PLAIN
    write_gcode_html(path, job, GcodePage(colour.key, first), outlines)


def _pushing(run: Path) -> Pushing:
    """What E counts, by the run's own profiles."""
    part = Manifest.load(run).facts.get("recipe", {}).get("printer", {})
    printer = load(Printer, str(part.get("profile", "generic_marlin")))
    if printer.pneumatic is not None:
        raise UsageError(
            f"{printer.name} has no plunger: its layers are shown by `printctl view "
            f"{run / GCODE} --printer ... --flow-ul-s ...`"
        )
    syringe = load(Syringe, str(part.get("syringe", "hamilton_1ml")))
    return Pushing(
        printer=printer,
        bore_mm=syringe.inner_mm,
        bore_said=syringe.name,
        syringe_mm=syringe.inner_mm,
        syringe_said=syringe.name,
        flow_ul_s=None,
        layer_mm=None,
        bead=load(Ink, str(part.get("ink", "collagen_fresh"))).bead_section,
    )
