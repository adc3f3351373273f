"""The scan page."""

from __future__ import annotations

import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

from nicegui import events, ui
from pydantic import ValidationError

from firmware_profiles.errors import wording
from printctl.web.design.embed import embed, follow_theme, run_in_thread
from printctl.web.design.page import room_style
from printctl.web.design.runs import RunProgress
from printctl.web.errors import WebError
from printctl.web.scan.findings import Findings, VesselFinding
from printctl.web.scan.routes import ScanMetadataRequest
from printctl.web.scan.service import ScanService
from printctl.web.scan.slices import AXES, Axis, OpenScan
from printctl.web.shell.frame import add_unusable_names, dialog_named, frame, run_or_notify, upload

# Form for the metadata that a scan's file lacks, such as voxel size.

Said = Callable[[ScanMetadataRequest], Awaitable[None]]


class MetadataForm:
    """Fields of what can be said of a scan.

    Parameters
    ----------
    said : function
        Told of what was said.
    """

    def __init__(self, on_change: Said) -> None:
        self._said = on_change
        self._box = ui.expansion("What the file doesn't say").classes("w-full pc-part")
        with self._box:
            self._why = ui.label().classes("pc-message")
            with ui.element("div").classes("pc-fields"):
                self._voxel = [
                    ui.number(f"voxel along {axis} (µm)", min=0.01, format="%.6g") for axis in "xyz"
                ]
                self._modality = _choice("modality", ["oct", "microct", "confocal"])
                self._scale = _choice("intensity", ["linear", "db"])
                self._index = ui.number("refractive index", min=1, max=2)
                self._optical = _choice("depth voxel counts", ["optical path", "length"])
                self._down = _choice("depth index grows", ["down", "up"])
                self._window = [
                    ui.number(f"dB of the {end} count") for end in ("lowest", "highest")
                ]
                self._counts = [ui.number(f"the {end} count") for end in ("lowest", "highest")]
                self._slope = ui.number("or counts per dB", min=0)
                self._zero = ui.number("dB of count 0")
                self._axes = ui.input("order of axes, slowest first", placeholder="zyx")
            numbers = (*self._window, *self._counts, self._slope, self._zero)
            for one in (*self._voxel, self._index, self._axes, *numbers):
                one.props("outlined dense stack-label").classes("pc-field")
            ui.button("Say so", on_click=self._say)

    def ask(self, why: str) -> None:
        """Open with the reason why something has to be said."""
        self._why.text = why
        self._box.value = bool(why)

    async def _say(self) -> None:
        size = [one.value for one in self._voxel]
        try:
            metadata = ScanMetadataRequest(
                voxel_um=tuple(size) if any(size) else None,
                refractive_index=self._index.value,
                optical_depth=_either(self._optical.value, "optical path", "length"),
                scale=self._scale.value,
                modality=self._modality.value,
                depth_down=_either(self._down.value, "down", "up"),
                axes=self._axes.value or None,
                db_range=_both(self._window),
                count_range=_both(self._counts),
                counts_per_db=self._slope.value,
                db_at_zero=self._zero.value,
            )
        except ValidationError as exc:
            first = exc.errors()[0]
            ui.notify(f"{'.'.join(map(str, first['loc']))}: {wording(first)}", type="negative")
            return
        await self._said(metadata)


def _choice(label: str, options: list[str]) -> ui.select:
    select = ui.select(options, label=label, clearable=True)
    return select.props("outlined dense stack-label").classes("pc-field")


def _both(ends: list[ui.number]) -> tuple[float, float] | None:
    """Two numbers, None where neither was given."""
    low, high = (one.value for one in ends)
    return None if low is None and high is None else (low, high)


def _either(value: str | None, yes: str, no: str) -> bool | None:
    return {yes: True, no: False}.get(value or "")


# Result view of the Scan page: verdict, alignment, vessels, report, files.

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


# Slice card of the Scan page: three planes, with sliders for position, window and threshold.

_SEEN: Final[dict[Axis, str]] = {
    "z": "Along z (from above)",
    "y": "Along y",
    "x": "Along x",
}
_MOST_STEPS: Final = 400


class SlicesCard:
    """Shows one scan."""

    def __init__(self) -> None:
        self._scan = ""
        self._opened: OpenScan | None = None
        self._images: dict[Axis, ui.element] = {}
        self._at: dict[Axis, ui.slider] = {}
        self._box = ui.column().classes("w-full gap-2")

    def show(self, scan: str, opened: OpenScan) -> None:
        """Show a scan that was read."""
        self._scan, self._opened = scan, opened
        self._images, self._at = {}, {}
        self._box.clear()
        with self._box:
            self._controls(opened)
            with ui.element("div").classes("pc-slices"):
                for axis in AXES:
                    self._plane(axis, opened)
        self._draw()

    def _controls(self, opened: OpenScan) -> None:
        low, high = opened.low, opened.high
        step = (high - low) / _MOST_STEPS
        with ui.row().classes("w-full items-end gap-4"):
            self._black = self._control("Black at", low, low - (high - low) / 2, high, step)
            self._white = self._control("White at", high, low, high + (high - low) / 2, step)
            self._tinted = ui.switch("Tint what is above the threshold", on_change=self._draw)
            self._threshold = self._control("Threshold", opened.threshold, low, high, step)

    def _control(self, name: str, value: float, low: float, high: float, step: float) -> ui.slider:
        with ui.column().classes("pc-control gap-0"):
            ui.label(name).classes("pc-quiet")
            slider = ui.slider(min=low, max=high, step=step, value=value, on_change=self._draw)
            return slider.props(f'aria-label="{name}" label debounce=150')

    def _plane(self, axis: Axis, opened: OpenScan) -> None:
        count = opened.scan.volume.shape[AXES[axis]]
        x, y, z = opened.size_mm
        width, height = {"z": (x, y), "y": (x, z), "x": (y, z)}[axis]
        with ui.element("figure").classes("pc-slice"):
            with ui.element("figcaption"):
                ui.label(f"{_SEEN[axis]}, {width:.3g} × {height:.3g} mm")
            image = ui.element("img").style(f"aspect-ratio: {width} / {height}")
            self._images[axis] = image
            slider = ui.slider(min=0, max=count - 1, value=count // 2, on_change=self._draw)
            slider.props(f'aria-label="Slice along {axis}" label debounce=60')
            self._at[axis] = slider

    def _draw(self) -> None:
        for axis, image in self._images.items():
            index = int(self._at[axis].value)
            asked = {"low": self._black.value, "high": self._white.value}
            if asked["low"] >= asked["high"]:
                return
            if self._tinted.value:
                asked["threshold"] = self._threshold.value
            query = urlencode({key: f"{value:.7g}" for key, value in asked.items()})
            image.props["src"] = f"/api/v1/scans/{self._scan}/slices/{axis}/{index}?{query}"
            image.props["alt"] = f"Slice {index} of the scan along {axis}"
            image.update()


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
        await add_unusable_names(self._service.core.workspace, "scans/*", "runs/*")
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
