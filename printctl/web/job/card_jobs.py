"""Jobs card of the Job page: upload a G-code file or choose one."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

from nicegui import events, run, ui

from printctl.machine.printing.print_words import span
from printctl.web.job.jobs import ENDINGS, JobEntry
from printctl.web.job.layout import Folds, date_text, live, run_or_explain, size, small
from printctl.web.job.service import JobService
from printctl.web.shell.uploading import upload


async def add_jobs(service: JobService, chosen: str, folds: Folds) -> None:
    """A list, each a link to its own page, and a place to drop a file."""
    with folds.card("Jobs"):
        problem_line = live().classes("job-problem")

        async def take(event: events.UploadEventArguments) -> None:
            entry, problem = await keep(service, event)
            problem_line.set_text(problem)
            if entry is not None:
                ui.navigate.to(way(entry.id))

        upload("Upload G-code", take, ",".join(ENDINGS), max_files=1)
        jobs = await run.io_bound(service.jobs) or []
        if not jobs:
            small("No job yet: upload a G-code file, or run a recipe on the page Design.")
        with ui.element("ul").classes("job-list"):
            for one in jobs:
                _row(one, chosen)


async def keep(
    service: JobService, event: events.UploadEventArguments
) -> tuple[JobEntry | None, str]:
    """Keep what a browser sent; never whole in memory."""
    with TemporaryDirectory(dir=service.core.workspace.private) as folder:
        came = Path(folder) / "upload"
        await event.file.save(came)

        def work() -> JobEntry:
            with came.open("rb") as handle:
                return service.upload(event.file.name, handle)

        return await run_or_explain(work)


def way(job: str) -> str:
    """The page of a job."""
    return f"/job?job={quote(job, safe='~')}"


def _row(one: JobEntry, chosen: str) -> None:
    with ui.element("li"):
        link = ui.link(target=way(one.id)).classes("job-row")
        if one.id == chosen:
            link.props('aria-current="true"')
        with link:
            ui.label(one.name).classes("font-semibold break-all")
            small(_facts(one))
            small(f"{date_text(one.changed)} · {size(one.size)} · SHA-256 {one.sha256[:12]}…")


def _facts(one: JobEntry) -> str:
    kind = "from a run" if one.id.startswith("run~") else "uploaded"
    known: list[Any] = [kind]
    if one.layers:
        known.append(f"{one.layers} layers")
    if one.duration_s is not None:
        known.append(span(one.duration_s))
    if one.ink_ul is not None:
        known.append(f"{one.ink_ul:.1f} µL of ink")
    return " · ".join(known if len(known) > 1 else [*known, "not checked yet"])
