"""Cards that move: jog, home, place, plunger."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from nicegui import events, ui

from firmware_profiles import Syringe, load
from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.layout import (
    Refresh,
    button,
    card,
    dialog,
    live,
    mm,
    note,
    number,
    quiet_button,
    run_or_explain,
)
from printctl.web.printer.printer_commands import STEPS_MM, fastest_ul_s, rim_mm
from printctl.web.printer.service import PrinterService
from printctl.web.shell.frame import run_or_notify

_RULE = (
    "Homing drives an axis to its switch, through whatever is in the way. With a needle above a "
    "dish it is refused: raise Z and take the needle off first. X and Y home at the height where "
    "the tip is now."
)


def home_dialog(service: PrinterService, who: Principal) -> Callable[[], None]:
    """Make the dialog; give what opens it."""
    with dialog("Home") as opened:
        note(_RULE)
        axes = {axis: ui.checkbox(f"{axis.upper()} axis", value=True) for axis in "xyz"}
        off = ui.checkbox("The needle is taken off")
        going = live()
        with ui.row().classes("gap-2"):
            button("Home these axes", lambda: home())
            quiet_button("Close", opened.close)

    async def home() -> None:
        chosen = [axis for axis, box in axes.items() if box.value]
        if not chosen:
            going.set_text("choose an axis")
            return
        going.set_text("homing …")
        done = await run_or_notify(service.hands.home, who, chosen, needle_off=bool(off.value))
        going.set_text("")
        if done is not None:
            opened.close()

    def show() -> None:
        off.set_value(False)
        going.set_text("")
        opened.open()

    return show


_PLACE_RULE = (
    "Nothing moves. The printer calls the place where its tip stands now by these numbers, and "
    "trusts them: measure, don't guess. What was touched off moves along. Needed after a needle "
    "was put on, for no axis homes with one above a dish."
)


def place_dialog(service: PrinterService, who: Principal) -> Callable[[], None]:
    """Make the dialog; give what opens it."""
    with dialog("Where the tip is") as opened:
        note(_PLACE_RULE)
        fields = [number(axis, None, -1000, 1000, 0.01, "mm") for axis in "XYZ"]
        button("The tip stands there", lambda: say())
        quiet_button("Cancel", opened.close)

    async def say() -> None:
        x, y, z = (None if field.value is None else float(field.value) for field in fields)
        if await run_or_notify(service.hands.set_position, who, x, y, z) is not None:
            opened.close()

    def show() -> None:
        place = service.status.position_mm or (None, None, None)
        for field, value in zip(fields, place, strict=True):
            field.set_value(None if value is None else round(value, 3))
        opened.open()

    return show


# Jog card of the Printer page: move the tip manually.

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


# Plunger card of the Printer page: remaining ink, push and draw back.


def add_plunger(service: PrinterService, who: Principal) -> Refresh:
    """A bar with its number, and the two ways."""
    rated: list[str] = []
    with card("Plunger"):
        left = ui.label().classes("text-2xl tabular-nums")
        bar = ui.linear_progress(0.0, show_value=False, size="16px").props(
            'instant-feedback aria-label="Ink left in the syringe"'
        )
        where = note()
        with ui.row().classes("gap-3"):
            volume = number("Volume", 1.0, 0, 1000, 0.5, "µL")
            rate = number("Rate", 1.0, 0, 1000, 0.1, "µL/s")
        fastest = note()
        with ui.row().classes("gap-2"):
            push = button("Push", lambda: go(1))
            draw = quiet_button("Draw back", lambda: go(-1))

    async def go(sign: int) -> None:
        if volume.value and rate.value:
            ul, ul_s = sign * float(volume.value), float(rate.value)
            await run_or_notify(service.hands.plunger, who, ul, ul_s)

    def refresh(status: StationStatus) -> None:
        left.set_text(_left(status))
        bar.set_value(_share(status))
        bar.set_visibility(status.ul_left is not None)
        where.set_text(_where(status))
        for one in (push, draw):
            one.set_enabled(status.state is StationState.READY and bool(status.mounted.syringe))
        if rated != [status.mounted.syringe, status.mounted.ink]:
            rated[:] = [status.mounted.syringe, status.mounted.ink]
            most = fastest_ul_s(status)
            fastest.set_text(
                "" if most is None else f"At most {most:.3g} µL/s with what is mounted."
            )
            if most is not None:
                rate.set_value(round(most, 3))

    return refresh


def _left(status: StationStatus) -> str:
    return "µL left: not known" if status.ul_left is None else f"{status.ul_left:.1f} µL left"


def _share(status: StationStatus) -> float:
    if status.ul_left is None or not status.mounted.syringe:
        return 0.0
    syringe = load(Syringe, status.mounted.syringe)
    return min(1.0, max(0.0, status.ul_left / (syringe.volume_ul - syringe.dead_volume_ul)))


def _where(status: StationStatus) -> str:
    if not status.mounted.syringe:
        return "No syringe is named: say what is mounted, or change the syringe."
    if status.plunger_mm is None:
        return "Nobody said where the plunger stands: change the syringe sets its zero."
    left = status.plunger_left_mm
    rest = "" if left is None else f", {left:.2f} mm to its end"
    return f"Plunger at {status.plunger_mm:.3f} mm of travel{rest}."
