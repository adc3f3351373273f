"""Pages of a run's network and of its layers, kept until the run changes."""

from __future__ import annotations

import csv
import hashlib
import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from design.network import VesselNetwork
from firmware_profiles import Printer, Syringe, load
from printctl.errors import UsageError
from printctl.gcode_view import Pushing, read_job, read_line_map
from printctl.networks import Drive, load_source
from printctl.oxygen import TABLE as OXYGEN
from printctl.pipeline.artefacts import NETWORK
from printctl.pipeline.manifest import Manifest
from printctl.pipeline.stages.toolpath import GCODE, LINE_MAP
from printctl.web.errors import ConflictError
from registration.picture import Quantity, quantities
from registration.picture.quantity import magnitude, signed
from registration.report import NetworkPage, ReportSurface, write_network_html
from registration.report.gcode import GcodePage, write_gcode_html
from registration.report.gcode.colouring import colourings

LUMENS: Final = "lumens.json"
_OF_NETWORK: Final = (NETWORK, "flow.csv", "tissue.stl", LUMENS, OXYGEN, "registration.json")
_OF_GCODE: Final = (GCODE, LINE_MAP)
_MAKING: Final = threading.Lock()
"""One page is made at a time: two would take the memory of both."""


def network_page(run: Path, kept: Path) -> Path:
    """The page of a run's network in its tissue.

    Parameters
    ----------
    run : Path
        Run folder.
    kept : Path
        Folder for pages.

    Raises
    ------
    ConflictError
        When the run has no network yet.
    """
    if not (run / NETWORK).is_file():
        raise ConflictError(f"run {run.name!r} has no network yet; make the design first")

    def make(path: Path) -> None:
        source = load_source(run, None, Drive())
        known = [*quantities(source.network, source.known), *_more(run, source.network)]
        surface = source.surface
        shown = [ReportSurface("Tissue", surface.vertices, surface.faces)] if surface else []
        page = NetworkPage(run.name, "radius", source.notes)
        write_network_html(path, source.network, known, shown, page)

    return _kept(run, kept, "network", _OF_NETWORK, make)


def gcode_page(run: Path, kept: Path) -> Path:
    """The page of a run's layers or passes, with a slider.

    Raises
    ------
    ConflictError
        When the run has no G-code yet.
    """
    if not (run / GCODE).is_file():
        raise ConflictError(f"run {run.name!r} has no G-code yet; make the design first")

    def make(path: Path) -> None:
        data = (run / GCODE).read_bytes()
        lines = data.count(b"\n") + (not data.endswith(b"\n"))
        line_map, _ = read_line_map(run / GCODE, lines)
        job = read_job(data, f"{run.name}/{GCODE}", _pushing(run), line_map)
        count = len(job.layers)
        first = count - 1 if job.layers.passes else (count - 1) // 2
        write_gcode_html(path, job, GcodePage(colourings(job)[0].key, first))

    return _kept(run, kept, "gcode", _OF_GCODE, make)


def _kept(
    run: Path, kept: Path, sort: str, names: tuple[str, ...], make: Callable[[Path], None]
) -> Path:
    """The page made of these files as they are; made now when they have changed."""
    files = [run / name for name in names if (run / name).is_file()]
    state = [(path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files]
    digest = hashlib.sha256(json.dumps(state).encode()).hexdigest()[:16]
    page = kept / f"{run.name}.{sort}.{digest}.html"
    with _MAKING:
        if not page.is_file():
            kept.mkdir(parents=True, exist_ok=True)
            make(page)
            for old in kept.glob(f"{run.name}.{sort}.*.html"):
                if old != page:
                    old.unlink(missing_ok=True)
    return page


def _more(run: Path, network: VesselNetwork) -> list[Quantity]:
    """What a run knows besides flow and scan: lumens by the G-code, and oxygen."""
    found = [
        signed("lumen", "Lumen error by the G-code", "µm", _lumen_error(run, network)),
        magnitude("oxygen", "Oxygen at the end", "mmol/L", _oxygen(run, network), log=False),
    ]
    return [one for one in found if one is not None]


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
    )
