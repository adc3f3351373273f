"""Result view of the Scan page: verdict, alignment, vessels, report, files."""

from __future__ import annotations

from nicegui import ui

from printctl.web.design.widgets.embed import embed
from printctl.web.scan.findings import Findings, VesselFinding

_OUTCOMES = {
    "pass": "Passed",
    "fail": "Not passed",
    "undecided": "Undecided: neither pass nor fail is proven",
    "": "No verdict yet",
}


class ResultCard:
    """Shows one registration."""

    def __init__(self) -> None:
        self._box = ui.column().classes("w-full gap-2")

    def clear(self) -> None:
        """Show nothing."""
        self._box.clear()

    def show(self, base: str, findings: Findings, files: list[str], has_report: bool) -> None:
        """Show findings; ``base`` is the registration's address in the API."""
        self._box.clear()
        with self._box:
            _heading("Verdict")
            ui.label(_OUTCOMES[findings.outcome]).classes("pc-state-line").props("role=status")
            for reason in findings.reasons:
                ui.label(reason)
            _heading("Alignment")
            with ui.element("dl").classes("pc-figures pc-wide"):
                for name, value in findings.alignment:
                    with ui.element("div"):
                        with ui.element("dt"):
                            ui.label(name)
                        with ui.element("dd"):
                            ui.label(value)
            _heading("Vessels")
            _vessels(findings.vessels)
            _heading("Files")
            with ui.row().classes("gap-3"):
                for file in files:
                    ui.link(file, f"{base}/files/{file}").classes("pc-file")
            if has_report:
                _heading("Deviation and report")
                embed(f"{base}/report", "Report of the registration")


def _heading(text: str) -> None:
    ui.label(text).classes("pc-h2").props("role=heading aria-level=2")


def _vessels(rows: tuple[VesselFinding, ...]) -> None:
    names = {
        "vessel": "Vessel",
        "kind": "Kind",
        "designed_um": "Designed (µm)",
        "measured_um": "Measured (µm)",
        "error_percent": "Error (%)",
        "rms_um": "RMS (µm)",
        "offset_um": "Axis off by (µm)",
        "verdict": "Verdict",
    }
    columns = [
        {"name": key, "label": name, "field": key, "sortable": True, "align": "right"}
        for key, name in names.items()
    ]
    shown = [{key: _shown(value) for key, value in vars(row).items()} for row in rows]
    table = ui.table(rows=shown, columns=columns, row_key="vessel", pagination=15)
    table.props("flat bordered dense").classes("w-full")


def _shown(value: object) -> object:
    return f"{value:.1f}" if isinstance(value, float) else value
