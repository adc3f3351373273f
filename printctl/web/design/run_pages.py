"""Pages of a run's network, G-code and tissue, made in a process of their own."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from design.network import VesselNetwork
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.analysis.networks import Drive, load_source
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.errors import UsageError
from printctl.failures import message_and_code
from printctl.pipeline.tissue_source import make_tissue
from printctl.pipeline.written_layers import run_outlines
from printctl.recipe.load import refusal
from printctl.recipe.tissue import TissuePart
from printctl.run_folder.artefacts import GCODE, OXYGEN
from printctl.run_folder.manifest import Manifest
from printctl.web.design.recipe_text import read_text
from printctl.web.design.run_views import LUMENS
from printctl.web.worker import lower_priority
from registration.report import NetworkPage, ReportSurface, write_network_html, write_places_html
from registration.report.gcode import GcodePage, write_gcode_html
from registration.report.gcode.colouring import PLAIN, colourings
from registration.report.picture import Quantity, quantities
from registration.report.picture.quantity import magnitude, signed


def write_network(run: Path, path: Path) -> None:
    """Write the page of a run's network in its tissue."""
    source = load_source(run, None, Drive())
    known = [*quantities(source.network, source.known), *_more(run, source.network)]
    surface = source.surface
    shown = [ReportSurface("Tissue", surface)] if surface else []
    page = NetworkPage(run.name, "radius", source.notes)
    write_network_html(path, source.network, known, shown, page)


def _more(run: Path, network: VesselNetwork) -> list[Quantity]:
    """What a run knows besides flow and scan: lumens by the G-code, and oxygen."""
    shown = [
        signed("lumen", "Lumen error by the G-code", "µm", _lumen_error(run, network)),
        magnitude("oxygen", "Oxygen at the end", "mmol/L", _oxygen(run, network), log=False),
    ]
    return [one for one in shown if one is not None]


def _lumen_error(run: Path, network: VesselNetwork) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    values = np.full(network.vessel_count, np.nan)
    if (run / LUMENS).is_file():
        rows = json.loads((run / LUMENS).read_text(encoding="utf-8")).get("lumens", [])
        for row in rows:
            number, error = str(row.get("lumen", "")), row.get("diameter_error_median_um")
            if number.isdigit() and int(number) < len(values) and error is not None:
                values[int(number)] = float(error)
    return values


def _oxygen(run: Path, network: VesselNetwork) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    values = np.full(network.vessel_count, np.nan)
    if (run / OXYGEN).is_file():
        with (run / OXYGEN).open(encoding="utf-8", newline="") as handle:
            for row in csv.DictReader(handle):
                number, level = row.get("vessel", ""), row.get("oxygen_out_millimolar")
                if number.isdigit() and int(number) < len(values) and level:
                    values[int(number)] = float(level)
    return values


# Write the HTML page that shows a run's G-code by layers or, embedded, by strokes.


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


def write_tissue(recipe: Path, path: Path) -> None:
    """Write the page of a recipe's tissue, on which places are picked."""
    section = read_text(recipe.read_text(encoding="utf-8")).get("tissue")
    if not isinstance(section, dict):
        raise UsageError("the recipe has no tissue yet; choose its kind first")
    try:
        part: TissuePart = TypeAdapter(TissuePart).validate_python(section)
    except ValidationError as exc:
        raise UsageError(refusal(exc, "tissue")) from exc
    tissue = make_tissue(part, recipe.parent)
    page = NetworkPage(recipe.stem, notes=tuple(tissue.notes))
    write_places_html(path, ReportSurface("Tissue", tissue.surface), page)


# Entry point of the worker that writes one HTML view: a run's network, its layers, a tissue.
#
# What can't be made is said in the last line of standard error, with exit code 1.

_WRITERS: Final = {"network": write_network, "layers": write_gcode, "tissue": write_tissue}


def main() -> int:
    """Make one page."""
    lower_priority()
    sort, run, page = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    try:
        _WRITERS[sort](run, page)
    except Exception as exc:
        known = message_and_code(exc)
        if known is None:
            raise
        print(" ".join(known[0].split()), file=sys.stderr)
        return 1
    return 0
