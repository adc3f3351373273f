"""Temperature and pressure card of the Printer page: live plots, heater targets."""

from __future__ import annotations

from typing import Any, Final

from nicegui import ui

from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.layout import Refresh, button, card, note, number, quiet_button
from printctl.web.printer.plots import KEPT_S
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Okabe and Ito's, told apart by the colour-blind; each line has a symbol of its own besides."""
DASHES: Final = ("solid", "dashed", "dotted", [10, 3, 2, 3])
EVERY_S: Final = 2.0
_TEXT: Final = "#7d8590"  # legible on white and on black


def add_plots(service: PrinterService, who: Principal) -> Refresh:
    """Plots of the last ten minutes, and a row for each heater."""
    heaters: dict[str, _Heater] = {}
    with card("Temperatures and pressure"):
        with (
            ui.element("div")
            .classes("w-full")
            .props('role=img aria-label="Temperatures of the last ten minutes; numbers below"')
        ):
            warm = ui.echart(_options("°C")).classes("w-full h-56")
        with (
            ui.element("div")
            .classes("w-full")
            .props(
                'role=img aria-label="Forces and pressures of the last ten minutes, limits; '
                'numbers below"'
            ) as beside
        ):
            pressed = ui.echart(_options("")).classes("w-full h-40")
        readings = note()
        rows = ui.column().classes("w-full gap-2")
        off = quiet_button("All heaters off", lambda: run_or_notify(service.hands.heaters_off, who))
    beside.set_visibility(False)

    def draw() -> None:
        columns = service.plots.columns()
        _show(warm, columns["at_s"], columns["now_c"], columns["target_c"], "target")
        if columns["readings"]:
            beside.set_visibility(True)
            _show(pressed, columns["at_s"], columns["readings"], columns["limits"], "limit")

    def refresh(status: StationStatus) -> None:
        off.set_enabled(status.open)
        readings.set_text("; ".join(status.readings))
        for one in status.temperatures:
            if one.name not in heaters:
                with rows:
                    heaters[one.name] = _Heater(service, who, one.name, one.target_c is not None)
            heaters[one.name].show(one.now_c, one.target_c, status.open)

    ui.timer(EVERY_S, draw)
    return refresh


class _Heater:
    """A heater's row: what it is at, and what it is to be at."""

    def __init__(self, service: PrinterService, who: Principal, name: str, heats: bool) -> None:
        self._name = name
        self._text = ui.label().classes("tabular-nums font-medium")
        with ui.row().classes("w-full items-center gap-2"):
            self._parts: list[Any] = []
            if not heats:
                return
            wanted = number(f"Target, {name}", None, 0, 300, 1, "°C")

            async def put() -> None:
                if wanted.value is not None:
                    await run_or_notify(service.hands.heat, who, name, float(wanted.value))

            self._parts = [
                button("Set", put),
                quiet_button("Off", lambda: run_or_notify(service.hands.heat, who, name, 0.0)),
            ]
            self._parts[0].props(f'aria-label="Set the target of the {name}"')
            self._parts[1].props(f'aria-label="Switch the {name} off"')

    def show(self, now: float, target: float | None, is_open: bool) -> None:
        """Show the numbers."""
        wanted = "" if target is None else f", target {target:.1f} °C" if target else ", off"
        self._text.set_text(f"{self._name} {now:.1f} °C{wanted}")
        for part in self._parts:
            part.set_enabled(is_open)


def _options(unit: str) -> dict[str, Any]:
    return {
        "animation": False,
        "grid": {"left": 48, "right": 16, "top": 36, "bottom": 28},
        "legend": {"top": 0, "type": "scroll", "textStyle": {"color": _TEXT, "fontSize": 13}},
        "tooltip": {"trigger": "axis"},
        "xAxis": {
            "type": "value",
            "min": -KEPT_S / 60,
            "max": 0,
            "name": "min",
            "axisLabel": {"color": _TEXT},
            "splitLine": {"show": False},
        },
        "yAxis": {
            "type": "value",
            "scale": True,
            "name": unit,
            "minInterval": 1,
            "axisLine": {"onZero": False},
            "nameTextStyle": {"color": _TEXT},
            "axisLabel": {"color": _TEXT},
            "splitLine": {"lineStyle": {"color": _TEXT, "opacity": 0.25}},
        },
        "series": [],
    }


def _show(
    chart: ui.echart,
    at_s: list[float],
    values: dict[str, list[float | None]],
    targets: dict[str, list[float | None]],
    word: str,
) -> None:
    if not at_s:
        return
    minutes = [round((at - at_s[-1]) / 60, 3) for at in at_s]
    series = []
    for index, (name, column) in enumerate(values.items()):
        colour = COLOURS[index % len(COLOURS)]
        dash = DASHES[index % len(DASHES)]
        series.append(_line(name, minutes, column, colour, dash, 2.5))
        if any(target is not None for target in targets.get(name, ())):
            line = _line(f"{name}, {word}", minutes, targets[name], colour, "dotted", 1.2)
            series.append({**line, "step": "end"})
    chart.run_chart_method("setOption", {"series": series}, {"replaceMerge": ["series"]})


def _line(
    name: str,
    minutes: list[float],
    column: list[float | None],
    colour: str,
    dash: str | list[int],
    width: float,
) -> dict[str, Any]:
    return {
        "type": "line",
        "name": name,
        "showSymbol": False,
        "data": list(zip(minutes, column, strict=True)),
        "itemStyle": {"color": colour},
        "lineStyle": {"color": colour, "type": dash, "width": width},
    }
