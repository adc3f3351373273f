"""Lay out the Printer page at /printer: cards for connection, jog, plunger, heat, console etc."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from nicegui import ui

from printctl.web.printer.cards_calibrating import add_calibrating
from printctl.web.printer.cards_console import add_console, add_macros, add_plots
from printctl.web.printer.cards_moving import add_jog, add_plunger
from printctl.web.printer.cards_set_up import (
    add_changing,
    add_connection,
    add_mounted,
    add_touching,
)
from printctl.web.printer.layout import Refresh
from printctl.web.printer.service import PrinterService
from printctl.web.shell.frame import frame, this_browser

REFRESH_S: Final = 0.5
_STYLE: Final = Path(__file__).with_name("printer.css")
_COLUMNS: Final = (
    (add_connection, add_jog, add_touching),
    (add_plots, add_mounted, add_plunger, add_changing),
    (add_console, add_macros, add_calibrating),
)
"""One below the other on a phone, beside each other where there is room."""


def register(service: PrinterService) -> None:
    """Define the page."""
    style = _STYLE.read_text(encoding="utf-8")

    @ui.page("/printer")
    def printer() -> None:
        who = this_browser()
        refreshes: list[Refresh] = []
        with frame("/printer"):
            ui.add_css(style)
            with ui.element("div").classes("pc-cards"):
                for column in _COLUMNS:
                    with ui.element("div").classes("pc-column"):
                        refreshes += [add(service, who) for add in column]

        def refresh() -> None:
            status = service.status
            for one in refreshes:
                one(status)

        refresh()
        ui.timer(REFRESH_S, refresh)
