"""The web application, and the rooms of the page."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from itertools import chain
from typing import Any

from fastapi import FastAPI
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.types import ASGIApp

from printctl.version import version
from printctl.web.api import (
    answer_errors,
    answer_unknown,
    router,
    serve_docs,
    watch_holder,
)
from printctl.web.commissioning import Commissioning
from printctl.web.commissioning import router as commissioning_router
from printctl.web.core import Core
from printctl.web.design.recipes import Recipes
from printctl.web.design.routes import recipe_routes, run_routes
from printctl.web.design.runs import Runs
from printctl.web.history.routes import router as history_router
from printctl.web.history.service import HistoryService
from printctl.web.job.routes import job_hints
from printctl.web.job.routes import routers as job_routers
from printctl.web.job.service import JobService, make_first_scene
from printctl.web.page.assets import serve_files, serve_page
from printctl.web.print_sockets import PrintSockets
from printctl.web.printer.routes import router as printer_router
from printctl.web.printer.service import PrinterService
from printctl.web.project.service import ProjectService
from printctl.web.project.service import router as project_router
from printctl.web.rest import API, GUARD_REFUSALS
from printctl.web.scan.service import ScanService
from printctl.web.scan.service import router as scan_router
from printctl.web.security.access import Access
from printctl.web.security.guard import Guard
from printctl.web.security.login import router as login_router


def build_app(core: Core, pages: bool = True) -> FastAPI:
    """Make the app of one server, with its page unless told otherwise; nobody guards it yet."""
    prints = PrintSockets(core.workspace.root)
    printer, job = PrinterService(core), JobService(core)
    runs = Runs(core.workspace, Recipes(core.workspace))
    project = ProjectService(core, runs)

    @asynccontextmanager
    async def running(app: FastAPI) -> AsyncIterator[None]:
        core.events.bind(asyncio.get_running_loop())
        tasks = [asyncio.create_task(watch_holder(core)), asyncio.create_task(prints.follow())]
        if pages:  # what somebody sees first is ready
            await job.scenes.start()
            tasks.append(asyncio.create_task(make_first_scene(job)))
        yield
        for task in tasks:
            task.cancel()
        await job.scenes.close()
        await project.sketches.close()
        await asyncio.to_thread(printer.close)  # prints and stations go on
        await asyncio.to_thread(job.close)

    app = FastAPI(
        title="printctl",
        version=version(),
        docs_url=None,
        redoc_url=None,
        openapi_url=f"{API}/openapi.json",
        lifespan=running,
        responses=GUARD_REFUSALS,
    )
    app.openapi = partial(_described, app.openapi)  # type: ignore[method-assign]
    answer_errors(app)
    app.include_router(
        router(core, prints, partial(runs.processes.end_rehearsals, core.workspace.root))
    )
    app.include_router(login_router())
    serve_docs(app)
    serve_files(app)
    for part in (
        printer_router(printer),
        commissioning_router(Commissioning(core)),
        *job_routers(job),
        recipe_routes(runs.recipes),
        run_routes(runs),
        scan_router(ScanService(core, runs)),
        history_router(HistoryService(core)),
        project_router(project),
    ):
        app.include_router(part)
    answer_unknown(app)
    if pages:
        serve_page(app, {"job": job_hints(job)})
    return app


def _described(make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Describe the API without what only Python code can meet: the exceptions of its functions."""
    made = make()
    for operation in chain.from_iterable(one.values() for one in made["paths"].values()):
        if "description" in operation:
            operation["description"] = operation["description"].partition("\n\nRaises\n")[0]
    return made


def guarded(app: FastAPI, core: Core, access: Access, stop_port: int) -> ASGIApp:
    """Put the guard around an app; it sees pages before they are compressed.

    Not compressed are the live view's scenes: a million moves are 24 MB, which would take seconds.
    """
    plain = (*DEFAULT_EXCLUDED_CONTENT_TYPES, "application/octet-stream")
    guard = Guard(app, access, core.settings, stop_port)
    return GZipMiddleware(guard, 1000, 5, exclude_content_types=plain)
