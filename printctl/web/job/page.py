"""Lay out the Job page at /job: job list, print state, live 3D view, preflight, start, after."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from nicegui import background_tasks, run, ui

from printctl.machine.link.inserts import file_count
from printctl.machine.printing.mend_strokes import MendStrokes
from printctl.web.job.card_after import add_after
from printctl.web.job.cards_before import add_preflight, add_start
from printctl.web.job.cards_looking import LooksCard, add_camera
from printctl.web.job.cards_print import PrintCard, add_jobs, last_report
from printctl.web.job.first_job import first_job, make_scene
from printctl.web.job.layout import Folds, card, run_or_explain, small
from printctl.web.job.record import PrintRecord
from printctl.web.job.service import JobService
from printctl.web.live.routes import LiveView, live_view, preload
from printctl.web.shell.frame import contained, frame, this_browser

REFRESH_S: Final = 0.5
_BEGUN_S: Final = 0.05
"""So long at most the page waits until its scene is asked for; building it holds up the loop."""
_STYLE: Final = Path(__file__).with_name("job.css")


def register(service: JobService) -> None:
    """Define the page."""
    style = _STYLE.read_text(encoding="utf-8")

    @ui.page("/job", response_timeout=30.0)  # else no frame, no stop
    async def job_page(job: str = "") -> None:
        with frame("/job"):
            ui.add_css(style)
            chosen = await run.io_bound(first_job, service, job) or ""
            if chosen:  # while the page is put together and the browser loads its scripts
                making = background_tasks.create(make_scene(service, chosen), name="scene")
                await asyncio.wait({making}, timeout=_BEGUN_S)
                ui.add_head_html(preload(chosen))
            folds = Folds()
            with ui.element("div").classes("job-cards") as cards:
                with (
                    ui.element("div").classes("job-column job-at-jobs"),
                    contained("The list of jobs"),
                ):
                    await add_jobs(service, chosen, folds)
                if chosen:
                    cards.classes("job-chosen")
                    await _cards(service, chosen, folds, cards)


def _live_view(service: JobService, job: str) -> LiveView:
    """What has been written, the needle, what comes next; all of a job that wasn't printed."""
    current = service.current()
    with card("Live view"), ui.element("div").classes("job-live"):
        return live_view(job, live=current is not None and current.job == job)


def _teller(
    view: LiveView, service: JobService, job: str
) -> Callable[[dict[str, Any]], Awaitable[None]]:
    """Tells the view of what was executed and put in, unless it knows."""
    known = 0, 0
    inserted: list[tuple[int, int]] = []
    mends: list[MendStrokes] = []
    shown: list[dict[str, Any]] = []

    async def tell(state: dict[str, Any]) -> None:
        nonlocal known, inserted, mends, shown
        now_in = [(after, count) for after, count in state.get("inserted", ())]
        if now_in != inserted:
            answer, _ = await run_or_explain(service.mends, job)
            inserted, mends = now_in, answer or []
        lines = int(state["lines_executed"]), int(state["lines_done"])
        now = file_count(lines[0], inserted), file_count(lines[1], inserted)
        drawn = [one.to_dict(lines[0]) for one in mends]
        if now != known or drawn != shown:
            counts = {"lines_executed": now[0], "lines_done": now[1]}
            view.tell(counts if drawn == shown else counts | {"mends": drawn})
            known, shown = now, drawn

    return tell


async def _cards(service: JobService, job: str, folds: Folds, cards: ui.element) -> None:
    who = this_browser()
    first, problem = await run_or_explain(service.set_up, job)
    if first is None:
        with card("Job"):
            small(problem)
        return
    machine, _ = await run_or_explain(service.machine)
    record, unwritten = await run_or_explain(service.record, job)
    with ui.element("div").classes("job-column job-at-print"):
        print_card = PrintCard(service, who, job)
        looks_card = LooksCard(service, who, job, print_card.ask_cancel)
    with ui.element("div").classes("job-column job-at-view"):
        tell_view = _teller(_live_view(service, job), service, job)
        await add_camera(service, job, folds)
    with ui.element("div").classes("job-column job-at-setup"):
        set_up = add_preflight(service, who, job, first, machine, folds)
    with ui.element("div").classes("job-column job-at-side"):
        if unwritten:
            small(unwritten).classes("job-problem")
        show_start = add_start(service, who, job, record or PrintRecord(), set_up, folds)
        await add_after(service, who, job, folds)

    def show(state: dict[str, Any] | None) -> None:
        going_on = state is not None and not state["ended"]
        first = going_on or _broke_off(state)
        cards.classes(**{"add" if first else "remove": "job-running"})
        folds.set(first)
        print_card.show(state, service.core.events.latest.get("station"))
        looks_card.show(state)
        show_start(going_on)

    async def refresh() -> None:
        state = service.core.events.latest.get("print")
        if state is not None and state["job"] == job:
            show(state)
            await tell_view(state)

    first_told = await last_report(service, job)
    show(first_told)
    if first_told is not None:
        await tell_view(first_told)
    ui.timer(REFRESH_S, refresh)


def _broke_off(state: dict[str, Any] | None) -> bool:
    """Whether somebody must say what next."""
    actions = () if state is None else state["actions"]
    return any(one["action"] == "give_up" and one["possible"] for one in actions)
