"""Lay out the Scan page at /scan: choose or upload a scan, register it with a run, show results."""

from __future__ import annotations

import tempfile
from pathlib import Path

from nicegui import events, ui

from printctl.web.design.page import room_style
from printctl.web.design.run_processes import RunProgress
from printctl.web.design.widgets.embed import follow_theme
from printctl.web.design.widgets.in_thread import run_in_thread
from printctl.web.errors import WebError
from printctl.web.scan.answers import ScanMetadataRequest
from printctl.web.scan.findings import Findings
from printctl.web.scan.service import ScanService
from printctl.web.scan.widgets.metadata_form import MetadataForm
from printctl.web.scan.widgets.result_card import ResultCard
from printctl.web.scan.widgets.slices_card import SlicesCard
from printctl.web.shell.dialogs import dialog_named
from printctl.web.shell.frame import frame
from printctl.web.shell.run_or_notify import run_or_notify
from printctl.web.shell.uploading import upload


def register(service: ScanService) -> None:
    """Define ``/scan``."""

    @ui.page("/scan", response_timeout=30.0)  # else no frame, no stop
    async def scan(scan: str = "", run: str = "") -> None:
        ui.add_css(room_style())
        with frame("/scan"):
            await _Page(service).build(scan, run)


class _Page:
    """What one browser sees."""

    def __init__(self, service: ScanService) -> None:
        self._service = service
        self._shown: RunProgress | None = None
        self._scan = ""

    async def build(self, scan: str, run_name: str) -> None:
        """Make the page, with a scan and a run to begin with."""
        with ui.row().classes("w-full items-center gap-2"):
            self._scans = ui.select([], label="Scan", on_change=self._chosen)
            self._runs = ui.select([], label="Design (run)", on_change=self._turned)
            for select in (self._scans, self._runs):
                select.props("outlined dense").classes("pc-recipe")
            ui.button("Add a scan", on_click=self._add)
            self._delete = ui.button("Delete this scan", on_click=self._throw).props("outline")
        self._facts = ui.label().classes("pc-state-line").props("role=status")
        self._form = MetadataForm(self._say)
        self._slices = SlicesCard()
        self._registering()
        self._result = ResultCard()
        await ui.context.client.connected()
        follow_theme()
        await self._refresh(scan, run_name)
        ui.timer(1.0, self._follow)

    def _registering(self) -> None:
        ui.label("Registration").classes("pc-h2").props("role=heading aria-level=2")
        with ui.row().classes("w-full items-center gap-2"):
            self._go = ui.button("Register", on_click=self._start)
            self._filled = ui.switch("Lumens are bright (filled with contrast agent)")
            self._cancel = ui.button("Cancel", on_click=self._stop).props("outline")
            self._simulate = ui.button(
                "Simulate the scan of this run's print, and register it", on_click=self._go_on
            ).props("outline")
        self._own = ui.label("This scan is the run's own: continuing the run registers it.")
        self._own.classes("pc-quiet")
        self._state = ui.label().classes("pc-message").props("role=status")
        self._bars = ui.column().classes("w-full gap-1")

    # --- which scan -------------------------------------------------------------------------

    async def _refresh(self, scan: str = "", run_name: str = "") -> None:
        scans = [row.scan for row in await run_in_thread(self._service.store.rows)]
        runs = [row.name for row in await run_in_thread(self._service.runs.rows)]
        chosen = scan if scan in scans else self._scan if self._scan in scans else ""
        chosen = chosen or (scans[0] if scans else "")
        own = chosen.removeprefix("run~") if chosen.startswith("run~") else ""
        now = next((one for one in (run_name, self._runs.value, own) if one in runs), None)
        self._runs.set_options(runs, value=now or (runs[0] if runs else None))
        self._scans.set_options(scans, value=chosen or None)
        if chosen:
            await self._show(chosen)
        else:
            self._facts.text = "No scan yet: add one, or simulate the scan of a simulated print."

    async def _chosen(self, event: events.ValueChangeEventArguments[str | None]) -> None:
        if event.value and event.value != self._scan:
            await self._show(event.value)

    async def _show(self, scan: str) -> None:
        self._scan = scan
        ui.navigate.history.replace(f"/scan?scan={scan}&run={self._runs.value or ''}")
        self._delete.set_enabled(scan.startswith("file~"))
        self._facts.text = f"{scan} is being read ..."
        try:
            opened = await run_in_thread(self._service.opened, scan)
        except WebError as exc:
            self._facts.text = f"{scan} can't be shown yet"
            self._form.ask(str(exc))
            return
        self._form.ask("")
        x, y, z = opened.scan.volume.shape[::-1]
        dz, dy, dx = (1e3 * one for one in opened.scan.geometric_voxel_mm)
        self._facts.text = (
            f"{scan}: {x} × {y} × {z} voxels of {dx:.4g} × {dy:.4g} × {dz:.4g} µm, "
            f"{opened.scan.modality}"
        )
        self._slices.show(scan, opened)
        self._shown = None
        await self._follow()

    async def _say(self, metadata: ScanMetadataRequest) -> None:
        await run_or_notify(self._service.store.say, self._scan, metadata.overrides())
        await self._show(self._scan)

    async def _throw(self) -> None:
        await run_or_notify(self._service.store.delete, self._scan)
        self._scan = ""
        await self._refresh()

    async def _add(self) -> None:
        with dialog_named("Add a scan") as dialog, ui.card().classes("pc-dialog"):
            ui.label("Add a scan").classes("pc-h2")
            ui.label(
                "TIFF, OME-TIFF, NRRD, NIfTI, DICOM, HDF5, MATLAB, Thorlabs .oct, Bioptigen, "
                "Heidelberg, .npz; or a .zip of TIFF or DICOM slices, or of an OME-Zarr."
            )

            async def taken(event: events.UploadEventArguments) -> None:
                dialog.close()
                with tempfile.TemporaryDirectory(dir=self._service.store.folder) as place:
                    arrived = Path(place) / "arrived"
                    await event.file.save(arrived)
                    scan = await run_or_notify(self._service.store.adopt, event.file.name, arrived)
                if scan is not None:
                    await self._refresh(scan)

            upload("Choose a volume", taken)
            ui.button("Close", on_click=dialog.close).props("flat")
        dialog.open()

    # --- registration -----------------------------------------------------------------------

    async def _turned(self, _: events.ValueChangeEventArguments[str | None]) -> None:
        self._shown = None
        await self._follow()

    async def _start(self) -> None:
        work = self._service.register
        await run_or_notify(work, self._scan, self._runs.value or "", bool(self._filled.value))
        await self._follow()

    async def _stop(self) -> None:
        await run_or_notify(self._service.cancel, self._scan, self._runs.value or "")
        await self._follow()

    async def _go_on(self) -> None:
        name = self._runs.value or ""
        if await run_or_notify(self._service.runs.go_on, name) is not None:
            self._shown = None

    def _look(self) -> tuple[RunProgress, Findings | None, str]:
        name, own = str(self._runs.value), f"run~{self._runs.value}"
        progress = self._service.progress(self._scan or own, name) if self._scan else None
        if progress is None or self._scan == own:
            progress = self._service.runs.progress(name)
        printed = "" if progress.going_on else self._service.runs.print_state(name)
        try:
            return progress, self._service.findings(self._scan or own, name), printed
        except WebError:
            return progress, None, printed

    async def _follow(self) -> None:
        if not self._runs.value:
            self._go.set_enabled(False)
            self._simulate.set_enabled(False)
            return
        try:
            now, finding, printed = await run_in_thread(self._look)
        except WebError as exc:
            self._state.text = str(exc)
            return
        own = self._scan == f"run~{self._runs.value}"
        self._go.set_enabled(bool(self._scan) and not own and not now.going_on)
        self._cancel.set_enabled(now.going_on)
        self._simulate.set_enabled(printed == "done" and not now.going_on)
        self._own.visible = own
        if now == self._shown:
            return
        ended = self._shown is not None and self._shown.going_on and not now.going_on
        self._shown = now
        self._show_progress(now)
        self._show_found(finding if not now.going_on else None)
        if ended and not self._scan:
            await self._refresh(f"run~{self._runs.value}")

    def _show_progress(self, now: RunProgress) -> None:
        words = "" if now.state in ("never", "done") else now.state
        self._state.text = f"{words}: {now.message}".strip(": ") if now.message else words
        self._bars.clear()
        with self._bars:
            for stage in now.stages if now.going_on or now.state == "failed" else ():
                with ui.row().classes("w-full items-center no-wrap"):
                    ui.label(stage.name).classes("pc-stage-name")
                    bar = ui.linear_progress(stage.fraction, show_value=False)
                    bar.props(f'aria-label="{stage.name}"').classes("pc-stage-bar")
                    ui.label(f"{stage.state} {stage.note}").classes("pc-stage-note")

    def _show_found(self, finding: Findings | None) -> None:
        if finding is None:
            self._result.clear()
            return
        scan, name = self._scan or f"run~{self._runs.value}", str(self._runs.value)
        base = f"/api/v1/scans/{scan}/with/{name}"
        files = self._service.files(scan, name)
        has_report = (self._service.folder(scan, name) / "report.html").is_file()
        self._result.show(base, finding, files, has_report)
