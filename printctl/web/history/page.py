"""Register the web pages /history and /history/PRINT: list of past prints, one print's page."""

from __future__ import annotations

from fastapi import Request
from nicegui import ui

from printctl.web.history.listing import Listing
from printctl.web.history.one_print import show_print
from printctl.web.history.service import HistoryService
from printctl.web.history.verifying import verify_card
from printctl.web.shell.frame import frame
from printctl.web.shell.run_or_notify import run_or_notify

WAY = "/history"


def register(service: HistoryService) -> None:
    """Define the pages.

    Parameters
    ----------
    service : HistoryService
    """

    @ui.page(WAY)
    async def listing(request: Request) -> None:
        with frame(WAY):
            await Listing(service, request.query_params).show()
            verify_card(service)

    @ui.page(f"{WAY}/{{print_id}}")
    async def one(print_id: str) -> None:
        with frame(WAY):
            ui.link("← All prints", WAY).classes("pc-way")
            shown = await run_or_notify(service.one, print_id)
            if shown is None:
                ui.label("There is no such print in the history.")
                return
            show_print(service, shown)
