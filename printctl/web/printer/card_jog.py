"""Jog card of the Printer page: move the tip manually."""

from __future__ import annotations

from typing import Any, Final

from nicegui import events, ui

from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.card_home import home_dialog
from printctl.web.printer.card_place import place_dialog
from printctl.web.printer.layout import Refresh, card, live, mm, note, quiet_button, run_or_explain
from printctl.web.printer.printer_commands import STEPS_MM, rim_mm
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

KEYS: Final = {
    "ArrowLeft": ("x", -1),
    "ArrowRight": ("x", 1),
    "ArrowDown": ("y", -1),
    "ArrowUp": ("y", 1),
    "PageDown": ("z", -1),
    "PageUp": ("z", 1),
}
# A key that is held repeats; only the first press moves, so that nothing piles up behind it.
_ON_KEY: Final = (
    "(e) => { if (%s.includes(e.key)) { e.preventDefault(); if (!e.repeat) emit(e.key); } }"
)
_PAD: Final = (
    (None, ("y", 1, "Y +"), None, ("z", 1, "Z +")),
    (("x", -1, "X −"), None, ("x", 1, "X +"), None),
    (None, ("y", -1, "Y −"), None, ("z", -1, "Z −")),
)


def add_jog(service: PrinterService, who: Principal) -> Refresh:
    """Position, pad, steps, limits, homing, and the way out of the bath."""
    moves: list[ui.button] = []
    with card("Move by hand"):
        places = _readout()
        trust = note()
        step = ui.toggle({one: f"{one:g} mm" for one in STEPS_MM}, value=1.0)
        step.props('no-caps aria-label="Step size"').classes("pc-steps")
        with (
            ui.element("div")
            .classes("pc-pad")
            .props(
                'tabindex=0 role=group aria-label="Jog pad: arrow keys move X and Y, Page Up and '
                'Page Down move Z, by the step chosen"'
            )
        ) as pad:
            for row in _PAD:
                for cell in row:
                    _cell(cell, lambda axis, sign: jog(axis, sign), moves)
        problem_line = live()
        limits, bath = note(), note()
        with ui.row().classes("gap-2"):
            moves.append(quiet_button("Up, out of the bath", lambda: run_or_notify(lift)))
            moves.append(quiet_button("Home …", home_dialog(service, who)))
            moves.append(quiet_button("Say where the tip is …", place_dialog(service, who)))
            quiet_button("Stop this move", lambda: run_or_notify(service.stop_motion))

    def lift() -> None:
        service.hands.lift_out(who)

    async def jog(axis: str, sign: int) -> None:
        problem_line.set_text("")
        problem_line.set_text(
            await run_or_explain(service.hands.jog, who, axis, sign * float(step.value))
        )

    def key(event: events.GenericEventArguments) -> Any:
        axis, sign = KEYS[str(event.args)]
        return jog(axis, sign)

    pad.on("keydown", key, js_handler=_ON_KEY % list(KEYS))

    def refresh(status: StationStatus) -> None:
        for label, value in zip(places, status.position_mm or (None,) * 3, strict=True):
            label.set_text(mm(value))
        trust.set_text(_trust(status))
        limits.set_text(_limits(status))
        bath.set_text(_bath(status))
        for one in moves:
            one.set_enabled(status.state is StationState.READY)

    return refresh


def _readout() -> list[ui.label]:
    places = []
    with ui.row().classes("w-full gap-x-5 gap-y-0"):
        for axis in "XYZ":
            with ui.row().classes("items-baseline gap-1 no-wrap"):
                ui.label(axis).classes("text-sm pc-muted")
                place = ui.label("–").classes("text-2xl tabular-nums").mark(f"place-{axis}")
                places.append(place)
                ui.label("mm").classes("text-sm pc-muted")
    return places


def _cell(cell: tuple[str, int, str] | None, jog: Any, moves: list[ui.button]) -> None:
    if cell is None:
        ui.element("span")
        return
    axis, sign, text = cell
    one = ui.button(text, on_click=lambda: jog(axis, sign)).props("no-caps")
    moves.append(one.classes("pc-jog"))


def _trust(status: StationStatus) -> str:
    if not status.open:
        return "not connected"
    if status.position_trusted:
        return "position trusted, printer's frame"
    homed = [axis for axis, done in zip("XYZ", status.homed, strict=True) if done]
    return "position not trusted: small steps alone; " + (
        f"{', '.join(homed)} homed" if homed else "no axis homed"
    )


def _limits(status: StationStatus) -> str:
    if not status.soft_low_mm or not status.soft_high_mm:
        return ""
    spans = (
        f"{axis} {low:.1f} to {high:.1f}"
        for axis, low, high in zip("XYZ", status.soft_low_mm, status.soft_high_mm, strict=True)
    )
    return f"From here one step may reach: {', '.join(spans)} mm"


def _bath(status: StationStatus) -> str:
    mounted = status.mounted
    known = {
        "dish's floor": mounted.floor_mm,
        "bath's surface": mounted.bath_level_mm,
        "rim": rim_mm(status),
    }
    limits = [f"{name} Z {value:.2f} mm" for name, value in known.items() if value is not None]
    return f"Soft limits: {', '.join(limits)}" if limits else "Floor, bath and rim: not known yet"
