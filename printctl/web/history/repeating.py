"""Repeat card of the History page: list differences, then prepare the same job again."""

from __future__ import annotations

from urllib.parse import quote

from nicegui import ui

from printctl.history.repeat import RepeatPlan
from printctl.web.history.layout import card
from printctl.web.history.service import HistoryService, PastPrintDetails
from printctl.web.shell.run_or_notify import run_or_notify


def repeat_card(service: HistoryService, shown: PastPrintDetails) -> None:
    """The card with its button and what it finds."""
    with card("Print it again"):
        ui.label(
            "The same G-code, byte for byte, as a new job. What isn't as it was then is told "
            "first; the print is started by you, on the Job page."
        )
        place = ui.element("div").props("role=status")

        async def look() -> None:
            plan = await run_or_notify(service.plan_repeat, shown.entry.id)
            if plan is not None:
                place.clear()
                with place:
                    _tell(service, plan)

        button = ui.button("Compare with today", on_click=look).props("outline no-caps")
        button.style("min-height:44px")
        if shown.found.gcode is None:
            button.disable()
            ui.label(f"Not possible here: {shown.found.missing[0]}.")


def _tell(service: HistoryService, plan: RepeatPlan) -> None:
    ui.label("The G-code is the one that was printed (its SHA-256 agrees).")
    with ui.element("ul"):
        for text in [one.line() for one in plan.differences] or ["Nothing that is known differs."]:
            with ui.element("li"):
                ui.label(text)
        for text in plan.unknown:
            with ui.element("li"):
                ui.label(f"Not known: {text}.")
    place = ui.element("div")

    async def make() -> None:
        job = await run_or_notify(service.repeat, plan.entry.id)
        if job is not None:
            button.disable()
            with place:
                ui.label(f"Job {job.partition('~')[2]} is ready.")
                ui.link("Go to the Job page", f"/job?job={quote(job)}").classes("pc-way")

    button = ui.button("Make the job", on_click=make).props("no-caps").style("min-height:44px")
    button.move(place)
