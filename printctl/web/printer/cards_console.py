"""Cards of console, macros and plots."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from nicegui import events, ui
from pydantic import ValidationError

from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError
from printctl.web.printer.console import Entry, Macro
from printctl.web.printer.following import KEPT_S
from printctl.web.printer.layout import (
    Refresh,
    button,
    card,
    dialog,
    live,
    note,
    number,
    quiet_button,
    run_or_explain,
)
from printctl.web.printer.service import PrinterService
from printctl.web.shell.frame import run_or_notify

SHOWN: Final = 100
_ON_KEY: Final = (
    "(e) => { if (['ArrowUp','ArrowDown','Enter'].includes(e.key)) "
    "{ e.preventDefault(); emit(e.key); } }"
)


def add_console(service: PrinterService, who: Principal) -> Refresh:
    """A log, and a line to type into."""
    recalled = _Recalled()
    shown = [0]
    with card("Console"):
        note(
            "What would break the link's count or position is refused; Arrow Up brings back what "
            "you typed."
        )
        log = (
            ui.element("div")
            .classes("pc-log")
            .props('role=log aria-label="Console: commands and replies" tabindex=0')
        )
        with ui.row().classes("w-full no-wrap items-center gap-2"):
            line = ui.input("Command", placeholder="M115").classes("grow")
            line.props('outlined autocomplete=off spellcheck=false input-class="font-mono"')
            send = button("Send", lambda: go())
        reply_line = live()

    async def go() -> None:
        text = str(line.value or "").strip()
        if not text:
            return
        recalled.add(text)
        line.set_value("")
        # What the console refuses stands in its log; the rest is said below the line.
        reply_line.set_text(await run_or_explain(service.console.send, who, text))

    async def key(event: events.GenericEventArguments) -> None:
        if event.args == "Enter":
            await go()
        else:
            line.set_value(recalled.step(-1 if event.args == "ArrowUp" else 1))

    line.on("keydown", key, js_handler=_ON_KEY)

    def refresh(status: StationStatus) -> None:
        send.set_enabled(status.open)
        fresh = service.console.entries(shown[0])[-SHOWN:]
        if not fresh:
            return
        with log:
            for entry in fresh:
                _show(entry)
        for old in list(log.default_slot.children)[:-SHOWN]:
            old.delete()
        shown[0] = fresh[-1].number
        ui.run_javascript(f"const l=getHtmlElement({log.id}); if (l) l.scrollTop=l.scrollHeight;")

    return refresh


class _Recalled:
    """What this browser typed, and where the arrows stand in it."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._at = 0

    def add(self, text: str) -> None:
        """Remember a line."""
        if self._lines[-1:] != [text]:
            self._lines.append(text)
        self._at = len(self._lines)

    def step(self, by: int) -> str:
        """Go back or forward; empty past the last."""
        self._at = min(len(self._lines), max(0, self._at + by))
        return self._lines[self._at] if self._at < len(self._lines) else ""


def _show(entry: Entry) -> None:
    with ui.element("div"):
        at = time.strftime("%H:%M:%S", time.localtime(entry.at_s))
        ui.label(f"{at} {entry.who} > {entry.text}").classes("pc-typed")
        for reply in entry.replies:
            ui.label(reply)
        if entry.refused:
            ui.label(f"refused: {entry.refused}").classes("pc-refused")


# Macro card of the Printer page, with the dialog that edits a macro.


def add_macros(service: PrinterService, who: Principal) -> Refresh:
    """A button for each, and a way to edit them."""
    shown: list[object] = [None]
    runs: list[ui.button] = []
    with card("Macros"):
        about = note()
        buttons = ui.row().classes("gap-2")
        edit = _dialog(service, who)
        new = quiet_button("New macro …", lambda: edit(service.store.name(_profile()), None))

    def _profile() -> str:
        return service.status.profile

    def rebuild(profile: str, macros: list[Macro]) -> None:
        buttons.clear()
        runs.clear()
        with buttons:
            for macro in macros:
                with ui.row().classes("gap-1 no-wrap"):
                    runs.append(
                        button(
                            macro.name,
                            lambda m=macro: run_or_notify(service.macros.run, who, m.name),
                        )
                    )
                    change = quiet_button("Edit", lambda m=macro: edit(profile, m))
                    change.props(f'aria-label="Edit {_plain(macro.name)}"')

    def refresh(status: StationStatus) -> None:
        new.set_enabled(status.open)
        profile = service.store.name(status.profile) if status.profile else ""
        macros = service.macros.of(profile) if status.open else []
        if shown[0] != (profile, macros):
            shown[0] = (profile, macros)
            rebuild(profile, macros)
            about.set_text(_about(profile, macros, status.open))
        for one in runs:
            one.set_enabled(status.state is StationState.READY)

    return refresh


def _about(profile: str, macros: list[Macro], is_open: bool) -> str:
    if not is_open:
        return "Each printer profile has its own; connect to see them."
    if not macros:
        return f"{profile} has none yet. A macro is commands as you would type them, under a name."
    return f"Of {profile}; sent like typed commands, until one is refused."


def _plain(text: str) -> str:
    """Without what would end an attribute of Quasar's props."""
    return text.replace('"', "'").replace("\\", "/")


def _dialog(service: PrinterService, who: Principal) -> Callable[[str, Macro | None], None]:
    of = {"profile": "", "was": ""}
    with dialog("Macro") as opened:
        name = ui.input("Name").props("outlined maxlength=40").classes("w-full")
        lines = ui.textarea("Commands, one a line").props("outlined").classes("w-full font-mono")
        with ui.row().classes("gap-2"):
            button("Save", lambda: save())
            remove = quiet_button("Remove", lambda: drop())
            quiet_button("Cancel", opened.close)

    def keep() -> bool:
        commands = tuple(t.strip() for t in str(lines.value or "").splitlines() if t.strip())
        try:
            macro = Macro(name=str(name.value or "").strip(), commands=commands)
        except ValidationError as exc:
            raise BadRequestError(
                "a macro has a name of 1 to 40 characters and 1 to 100 commands"
            ) from exc
        service.macros.save(who, of["profile"], macro)
        if of["was"] and of["was"] != macro.name:
            service.macros.remove(who, of["profile"], of["was"])
        return True

    async def save() -> None:
        if await run_or_notify(keep):
            opened.close()

    async def drop() -> None:
        await run_or_notify(service.macros.remove, who, of["profile"], of["was"])
        opened.close()

    def show(profile: str, macro: Macro | None) -> None:
        of.update(profile=profile, was=macro.name if macro else "")
        name.set_value(macro.name if macro else "")
        lines.set_value("\n".join(macro.commands) if macro else "")
        remove.set_visibility(macro is not None)
        opened.open()

    return show


# Temperature and pressure card of the Printer page: live plots, heater targets.

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
        _show_plot(warm, columns["at_s"], columns["now_c"], columns["target_c"], "target")
        if columns["readings"]:
            beside.set_visibility(True)
            _show_plot(pressed, columns["at_s"], columns["readings"], columns["limits"], "limit")

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


def _show_plot(
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
