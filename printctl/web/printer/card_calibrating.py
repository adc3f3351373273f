"""Calibration card of the Printer page: available calibrations, their needs, their wizards."""

from __future__ import annotations

from nicegui import ui

from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.card_wizard import wizard_dialog
from printctl.web.printer.layout import Refresh, card, note, quiet_button
from printctl.web.printer.service import PrinterService


def add_calibrating(service: PrinterService, who: Principal) -> Refresh:
    """A row for each calibration."""
    with card("Calibration"):
        note("The same tests and fits as `printctl calibrate`; every number with its interval.")
        with ui.element("ul").classes("pc-list"):
            for wizard in service.calibrating.wizards:
                with ui.element("li"):
                    with ui.column().classes("gap-0 grow"):
                        ui.label(wizard.title).classes("font-semibold")
                        note(f"Needs {wizard.needs}; gives {wizard.gives}.")
                    if wizard.columns:
                        show = wizard_dialog(service, who, wizard)
                        quiet_button("Start …", show).props(f'aria-label="Start: {wizard.title}"')
                    else:
                        note(f"printctl calibrate {wizard.name}").classes("font-mono")

    def refresh(status: StationStatus) -> None:
        """Nothing here changes with the printer."""

    return refresh
