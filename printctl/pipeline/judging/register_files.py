"""Write the output of `printctl register`: results, page, exports."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from design.measures.morphometry import network_strahler_orders
from printctl.machine.records.folders import print_identity
from printctl.observe.records import LOOKS_FOLDER
from printctl.pipeline.facts import scan_origin
from printctl.pipeline.judging.page_parts import PageParts
from printctl.pipeline.judging.register_and_judge import JudgedScan, ScannedDesign
from printctl.pipeline.judging.verdict import verdict
from printctl.processes.second import Call, SecondProcess
from printctl.run_folder.artefacts import JOURNAL_FOLDER, NUMBERS
from registration.json_ready import Record
from registration.result import scaled_vertices
from report import ReportSurface
from report.deviation_surfaces import split_surfaces
from report.packing import pack_surfaces

PAGES: Final = "printctl.pipeline.judging.registration_pages"
"""What draws and writes the pages; called by this name, it loads in the second process alone."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignRead(ScannedDesign):
    """A design, and which print of it was scanned.

    Attributes
    ----------
    model : Path
        A run folder, or the design's STL.
    printed : dict or None
        As far as a journal tells it (`print_identity`).
    """

    model: Path
    printed: Record | None


@dataclass(frozen=True, eq=False)
class RegisteredScan:
    """A judged scan, its file and its design's.

    Attributes
    ----------
    source : Path
        The scan's file.
    read : DesignRead
    judged : JudgedScan
    """

    source: Path
    read: DesignRead
    judged: JudgedScan

    def data(self) -> dict[str, Any]:
        """Numbers and verdict, as ``registration.json`` holds them."""
        return {
            "schema": 1,
            "recipe": self.source.stem,
            "verdict": verdict(self.judged.numbers),
            "scan": {"source": str(self.source)},
            "printed": self.read.printed,
            "registration": self.judged.numbers,
        }

    def write(
        self, out: Path, data: Record, pdf: bool, second: SecondProcess, drawn: Call
    ) -> list[str]:
        """Write all files of `data` into `out`; say what they don't serve.

        `second` draws and writes the pages; `drawn`: its figures that are drawn already
        (`registration_pages.network_drawing`).
        """
        out.mkdir(parents=True, exist_ok=True)
        drawn = second.call(PAGES, "all_figures", data, self.read.vessels, drawn.result())
        with ThreadPoolExecutor(1) as beside:  # compresses while pictures are taken
            exports = beside.submit(self.judged.write, out)
            parts = self._parts(data, pdf, drawn)
            pages = second.call(PAGES, "write_pages", out, parts)
            made, why_not = self._origin(out)
            write_text(
                out / NUMBERS, json.dumps({**data, **made}, indent=1, allow_nan=False) + "\n"
            )
            exports.result()
            pages.result()
        return why_not

    def _parts(self, data: Record, pdf: bool, drawn: Call) -> PageParts:
        views, surfaces = self.judged.views(), pack_surfaces(self._surfaces())
        origin = scan_origin(self.source, self.read.network) if pdf else None
        orders = network_strahler_orders(self.read.vessels)
        made = drawn.result(), origin, self._observed()
        return PageParts(data, surfaces, self.read.vessels, orders, views, *made)

    def _observed(self) -> Path | None:
        """Folder of the print that was scanned, where it was observed."""
        folder = self.read.model / JOURNAL_FOLDER
        if self.read.printed is None or not (folder / LOOKS_FOLDER).is_dir():
            return None
        return folder if print_identity(folder) == self.read.printed else None

    def _surfaces(self) -> list[ReportSurface]:
        found = self.judged.found
        vertices, deviation_um = scaled_vertices(found), found.scaled_deviation_um
        return [
            *split_surfaces(vertices, found.surface.faces, deviation_um, self.read.vessels),
            ReportSurface("As designed", self.read.surface),
        ]

    def _origin(self, out: Path) -> tuple[dict[str, object], list[str]]:
        """How the part was made, where the model is a run, and why a compensation can't use it."""
        if not self.read.model.is_dir():
            return {}, []
        # All that makes a run; a lone STL doesn't wait for it.
        from printctl.corrections.feedback import NO_ORIGIN, keep_origin

        made = keep_origin(self.read.model, self.source, out)
        if NO_ORIGIN not in made:
            return made, []
        return made, [f"`printctl compensate` can't use this registration: {made[NO_ORIGIN]}"]
