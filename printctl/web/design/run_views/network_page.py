"""Write the HTML page of a run's network in its tissue."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from printctl.analysis.networks import Drive, load_source
from printctl.run_folder.artefacts import OXYGEN
from printctl.web.design.run_views.views import LUMENS
from registration.report import NetworkPage, ReportSurface, write_network_html
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
