"""Pages of a run's network, G-code and tissue, made in a process of their own."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter, ValidationError
from rich.console import Console

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.analysis.networks import Drive, load_source
from printctl.checks.gcode_view import read_job, read_line_map
from printctl.errors import UsageError
from printctl.failures import message_and_code
from printctl.pipeline.prepared.written_layers import pushing_of, remembered, run_outlines
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe.load import refusal
from printctl.recipe.schema import user_path
from printctl.recipe.sections.tissue import TissuePart
from printctl.run_folder.artefacts import GCODE, OXYGEN
from printctl.web.design.recipe_text import read_text
from printctl.web.design.run_views import LUMENS
from printctl.web.worker import lower_priority
from report import NetworkPage, ReportSurface, write_network_html, write_places_html
from report.gcode import GcodePage, write_gcode_html
from report.gcode.colouring import PLAIN, colourings
from report.picture import Quantity, quantities
from report.picture.quantity import magnitude, signed


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
    lumens = json.loads(_text(run / LUMENS) or "{}").get("lumens", [])
    errors = [(str(row.get("lumen", "")), row.get("diameter_error_median_um")) for row in lumens]
    rows = csv.DictReader(_text(run / OXYGEN).splitlines())
    levels = [(row.get("vessel", ""), row.get("oxygen_out_millimolar")) for row in rows]
    error, oxygen = (_by_vessel(network, pairs) for pairs in (errors, levels))
    shown = [
        signed("lumen", "Lumen error by the G-code", "µm", error),
        magnitude("oxygen", "Oxygen at the end", "mmol/L", oxygen, log=False),
    ]
    return [one for one in shown if one is not None]


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _by_vessel(network: VesselNetwork, pairs: list[tuple[str, Any]]) -> FloatArray:
    """Return the values that are given of vessels, by their number; NaN for the others."""
    values = np.full(network.vessel_count, np.nan)
    for number, value in pairs:
        if number.isdigit() and int(number) < len(values) and value not in (None, ""):
            values[int(number)] = float(value)
    return values


def write_gcode(run: Path, path: Path) -> None:
    """Write the page of a run's layers or passes."""
    data = (run / GCODE).read_bytes()
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    line_map, _ = read_line_map(run / GCODE, lines)
    job = read_job(
        data, f"{run.name}/{GCODE}", pushing_of(remembered(run, Console(quiet=True))), line_map
    )
    count = len(job.layers)
    first = count - 1 if job.layers.passes else (count - 1) // 2
    outlines = run_outlines(run, job)
    colour = colourings(job)[0] if outlines is None else PLAIN
    write_gcode_html(path, job, GcodePage(colour.key, first), outlines)


def write_tissue(recipe: Path, path: Path) -> None:
    """Write the page of a recipe's tissue, on which places are picked."""
    section = read_text(recipe.read_text(encoding="utf-8")).get("tissue")
    if not isinstance(section, dict):
        raise UsageError("the recipe has no tissue yet; choose its kind first")
    try:
        part: TissuePart = TypeAdapter(TissuePart).validate_python(section)
    except ValidationError as exc:
        said = refusal(exc, recipe.name, lambda loc: user_path(("tissue", *loc)))
        raise UsageError(said) from exc
    tissue = make_tissue(part, recipe.parent)
    page = NetworkPage(recipe.stem, notes=tuple(tissue.notes))
    write_places_html(path, ReportSurface("Tissue", tissue.surface), page)


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
