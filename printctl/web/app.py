"""The server's parts put together: rooms, API, pages."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi.responses import RedirectResponse
from starlette.responses import Response

from printctl.web.api.errors import answer_errors
from printctl.web.api.routes import router
from printctl.web.core import Core
from printctl.web.rooms import make_services, register_pages, routers

API = "/api/v1"


def build_app(core: Core, pages: bool = True) -> FastAPI:
    """Make the app of one server.

    Parameters
    ----------
    core : Core
    pages : bool
        Whether the pages are served, too; NiceGUI knows one such app a process.
    """

    @asynccontextmanager
    async def running(app: FastAPI) -> AsyncIterator[None]:
        core.events.bind(asyncio.get_running_loop())
        yield

    app = FastAPI(
        title="printctl",
        docs_url=None,
        redoc_url=None,
        openapi_url=f"{API}/openapi.json",
        lifespan=running,
    )
    answer_errors(app)
    app.include_router(router(core))
    services = make_services(core)
    for part in routers(services):
        app.include_router(part)
    if pages:
        _add_pages(app, core)
        register_pages(services)
    return app


def _add_pages(app: FastAPI, core: Core) -> None:
    from nicegui import ui  # Takes half a second, and the API does without.

    from printctl.web.shell.assets import serve_assets

    @app.get("/", include_in_schema=False)
    def first() -> Response:
        return RedirectResponse("/printer")

    serve_assets(app)
    ui.run_with(
        app,
        title="printctl",
        dark=None,
        language="en-US",
        show_welcome_message=False,
        gzip_middleware_factory=None,
    )
