"""Mounted-parts card of the Printer page: declare needle, syringe, ink, dish and bath."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Syringe
from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.layout import (
    Refresh,
    button,
    card,
    dialog,
    mm,
    note,
    number,
    quiet_button,
)
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

SORTS: dict[str, type[Facts]] = {
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "dish": Dish,
    "bath": Bath,
}


def add_mounted(service: PrinterService, who: Principal) -> Refresh:
    """What was said, and a dialog to say something else."""
    shown: dict[str, ui.label] = {}
    with card("What is mounted"):
        note("The soft limits, µL and temperatures go by this; nobody can check it but you.")
        with ui.element("dl").classes("pc-facts"):
            for sort in (*SORTS, "dish's middle"):
                with ui.element("dt"):
                    ui.label(sort.capitalize())
                with ui.element("dd"):
                    shown[sort] = ui.label("–")
        show = _dialog(service, who)
        change = quiet_button("Say what is mounted …", show)

    def refresh(status: StationStatus) -> None:
        change.set_enabled(status.open)
        for sort in SORTS:
            given = str(getattr(status.mounted, sort))
            shown[sort].set_text(service.store.name(given) if given else "not said")
        centre = status.mounted.dish_centre_mm
        shown["dish's middle"].set_text(
            "not said" if centre is None else f"X {mm(centre[0])}, Y {mm(centre[1])} mm"
        )

    return refresh


def _dialog(service: PrinterService, who: Principal) -> Any:
    choices: dict[str, ui.select] = {}
    with dialog("What is mounted") as opened:
        for sort, model in SORTS.items():
            names = {
                "": "nothing, or not known",
                **{n: n for n in service.store.names(model)},
            }
            choice = ui.select(names, label=sort.capitalize(), value="").classes("w-full")
            choices[sort] = choice
        with ui.row().classes("gap-2 items-center"):
            x = number("Dish's middle X", None, -1000, 1000, 0.1, "mm")
            y = number("Dish's middle Y", None, -1000, 1000, 0.1, "mm")
            quiet_button("Where the tip is", lambda: here())
        with ui.row().classes("gap-2"):
            button("That is mounted", lambda: say())
            quiet_button("Cancel", opened.close)

    def here() -> None:
        place = service.status.position_mm
        if place is not None:
            x.set_value(place[0])
            y.set_value(place[1])

    def said() -> dict[str, Any]:
        fields: dict[str, Any] = {}
        for sort, model in SORTS.items():
            name = str(choices[sort].value)
            fields[sort] = service.store.given(model, name) if name else ""
        if x.value is not None and y.value is not None:
            fields["dish_centre_mm"] = (float(x.value), float(y.value))
        now = service.status.mounted
        return {key: value for key, value in fields.items() if value != getattr(now, key)}

    async def say() -> None:
        if await run_or_notify(lambda: service.hands.mount(who, **said())) is not None:
            opened.close()

    def show() -> None:
        mounted = service.status.mounted
        for sort, choice in choices.items():
            given = str(getattr(mounted, sort))
            choice.set_value(service.store.name(given) if given else "")
        if mounted.dish_centre_mm is not None:
            x.set_value(mounted.dish_centre_mm[0])
            y.set_value(mounted.dish_centre_mm[1])
        opened.open()

    return show
