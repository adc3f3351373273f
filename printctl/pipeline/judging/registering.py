"""Judge a registered scan and write the output of `printctl register`: results, page, exports."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from design.files import write_text
from design.measures.morphometry import network_strahler_orders
from design.network import VesselNetwork
from design.solids import Solid
from printctl.machine.records.folders import print_identity
from printctl.observe.records import LOOKS_FOLDER
from printctl.pipeline.facts import scan_origin
from printctl.pipeline.judging.measurement_record import Corrections, add_record
from printctl.pipeline.judging.page_parts import PageParts
from printctl.pipeline.judging.verdict import verdict
from printctl.processes.second import Call, SecondProcess
from printctl.recipe.sections.record import RecordPart
from printctl.run_folder.artefacts import JOURNAL_FOLDER, NUMBERS
from printctl.run_folder.registration_files import (
    AS_CORDS,
    DEVIATION,
    design_facts,
    scan_facts,
    surface_facts,
    write_deviation,
    write_exports,
)
from registration import RegistrationReport, Scan, report_dict
from registration.devices.optics import is_resampled
from registration.measuring.judging import Tolerances, judge, withhold_unsure
from registration.result import SIGN, scaled_vertices
from report import ReportSurface
from report.deviation_surfaces import split_surfaces
from report.packing import pack_surfaces
from report.views import add_scan_places, take_views

if TYPE_CHECKING:
    from design.solids.axes.lumen_axes import FoundLumens

PAGES: Final = "printctl.pipeline.judging.registration_pages"
"""What draws and writes the pages; called by this name, it loads in the second process alone."""


@dataclass(frozen=True, eq=False)
class DesignRead:
    """A design, and which print of it was scanned.

    Attributes
    ----------
    model : Path
        A run folder, or the design's STL.
    surface : Solid
        In mm.
    network : Path
        network.csv, mm.
    vessels : VesselNetwork
    printed : dict or None
        As far as a journal tells it (`print_identity`).
    lumens : FoundLumens or None
        Of a network that was found in the model: what is unsure of it.
    cords : bool
        Whether it was written as solid cords.
    """

    model: Path
    surface: Solid
    network: Path
    vessels: VesselNetwork
    printed: dict[str, Any] | None
    lumens: FoundLumens | None = None
    cords: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class RegisteredScan(DesignRead):
    """A scan, the design it was held against, and what came of it.

    Attributes
    ----------
    source : Path
        The scan's file.
    scan : Scan
    found : RegistrationReport
    """

    source: Path
    scan: Scan
    found: RegistrationReport

    def add_record(
        self, data: dict[str, Any], stated: RecordPart, done: Corrections, now: datetime
    ) -> None:
        """Put the measurement record to the numbers that `judged` gave."""
        add_record(data["registration"], stated, self.scan, done, now)

    def judged(self, tolerances: Tolerances) -> dict[str, Any]:
        """Numbers and verdict, as ``registration.json`` holds them.

        Raises
        ------
        ToleranceError
            When the tolerances name a vessel or kind that the network doesn't have.
        """
        measured = report_dict(self.found) | (AS_CORDS if self.cords else {})
        if self.lumens is not None:
            withhold_unsure(measured, self.lumens.stretches)
            measured["unfollowed"] = {
                "share": self.lumens.left,
                "at_mm": self.lumens.left_at.round(3).tolist(),
            }
        numbers = {
            **judge(measured, tolerances),
            "sign_convention": SIGN,
            "design": design_facts(self.network),
            "measured_by": scan_facts(self.scan),
            "by_surface": surface_facts(self.found, self.vessels),
        }
        add_scan_places(numbers, self.scan, self.found)
        return {
            "schema": 1,
            "recipe": self.source.stem,
            "verdict": verdict(numbers),
            "scan": {"source": str(self.source)},
            "printed": self.printed,
            "registration": numbers,
        }

    def write(
        self, out: Path, data: dict[str, Any], pdf: bool, second: SecondProcess, drawn: Call
    ) -> list[str]:
        """Write all files of `data`, which `judged` gave, into `out`; say what they don't serve.

        `second` draws and writes the pages; `drawn`: its figures that are drawn already
        (`registration_pages.network_drawing`).
        """
        out.mkdir(parents=True, exist_ok=True)
        drawn = second.call(PAGES, "all_figures", data, self.vessels, drawn.result())
        with ThreadPoolExecutor(1) as beside:  # compresses while pictures are taken
            judged = self.found, data["registration"]
            exports = beside.submit(write_exports, out, self.scan, self.vessels, judged)
            parts = self._parts(data, pdf, drawn)
            pages = second.call(PAGES, "write_pages", out, parts)
            made, why_not = self._origin(out)
            write_text(out / NUMBERS, _json(data | made))
            write_deviation(out / DEVIATION, self.found)
            exports.result()
            pages.result()
        return why_not

    def _parts(self, data: dict[str, Any], pdf: bool, drawn: Call) -> PageParts:
        views = take_views(
            self.scan, self.surface, self.found, data["registration"], not is_resampled(self.scan)
        )
        surfaces = pack_surfaces(self._surfaces())
        origin = scan_origin(self.source, self.network) if pdf else None
        orders = network_strahler_orders(self.vessels)
        return PageParts(
            data, surfaces, self.vessels, orders, views, drawn.result(), origin, self._observed()
        )

    def _observed(self) -> Path | None:
        """Folder of the print that was scanned, where it was observed."""
        folder = self.model / JOURNAL_FOLDER
        if self.printed is None or not (folder / LOOKS_FOLDER).is_dir():
            return None
        return folder if print_identity(folder) == self.printed else None

    def _surfaces(self) -> list[ReportSurface]:
        vertices, deviation_um = scaled_vertices(self.found), self.found.scaled_deviation_um
        return [
            *split_surfaces(vertices, self.found.surface.faces, deviation_um, self.vessels),
            ReportSurface("As designed", self.surface),
        ]

    def _origin(self, out: Path) -> tuple[dict[str, Any], list[str]]:
        """How the part was made, where the model is a run, and why a compensation can't use it."""
        if not self.model.is_dir():
            return {}, []
        # All that makes a run; a lone STL doesn't wait for it.
        from printctl.corrections.feedback import NO_ORIGIN, keep_origin

        made = keep_origin(self.model, self.source, out)
        if NO_ORIGIN not in made:
            return made, []
        return made, [f"`printctl compensate` can't use this registration: {made[NO_ORIGIN]}"]


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, indent=1, allow_nan=False) + "\n"
