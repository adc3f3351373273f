"""Plunger card of the Printer page: remaining ink, push and draw back."""

from __future__ import annotations

from nicegui import ui

from firmware_profiles import Syringe, load
from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.layout import Refresh, button, card, note, number, quiet_button
from printctl.web.printer.printer_commands import fastest_ul_s
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify


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
