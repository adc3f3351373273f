"""Slice card of the Scan page: three planes, with sliders for position, window and threshold."""

from __future__ import annotations

from typing import Final
from urllib.parse import urlencode

from nicegui import ui

from printctl.web.scan.slices import AXES, Axis, OpenScan

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
