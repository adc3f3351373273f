"""Form for the metadata that a scan's file lacks, such as voxel size."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui
from pydantic import ValidationError

from firmware_profiles.errors import wording
from printctl.web.scan.answers import ScanMetadataRequest

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
