"""REST API basics: health, events, control lock, stop; error responses; API reference page."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Final

from fastapi import APIRouter, FastAPI, Request, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse

from design.errors import DesignError
from firmware_profiles import ProfileError
from firmware_profiles.errors import wording
from printctl.errors import PrintctlError
from printctl.machine.errors import LinkError
from printctl.system_errors import explain
from printctl.version import version
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import NotFoundError
from printctl.web.page.assets import link
from printctl.web.print_sockets import UNCONFIRMED, PrintSockets, SentStop
from printctl.web.rest import API, REFUSALS, Asking, error_response, requesting_user
from registration.errors import RegistrationError

log = logging.getLogger("printctl.web")
BEAT_S: Final = 3.0
"""So often a listener hears that the server lives, even without news."""
_CONFLICT: Final = 409
_LONGEST_VALUE: Final = 60
"""Of a wrong value in a message, characters."""
_REHEARSALS_END_S: Final = 1.0
"""For as long an answer waits for them; they end all the same."""


def serve_docs(app: FastAPI) -> None:
    """Have the app show its API at ``/api/docs``."""

    @app.get("/api/docs", include_in_schema=False)
    def docs() -> HTMLResponse:
        return HTMLResponse(
            '<!doctype html><html lang="en"><head><title>API · printctl</title>'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<link rel="stylesheet" href="{link("page.css")}">'
            f'<script src="{link("theme.js")}"></script>'
            f'<script type="module" src="{link("reference.js")}"></script></head>'
            f'<body><main class="page reference" data-api="{API}/openapi.json">'
            '<h1>printctl: API</h1><p><a href="/">Back to the page</a></p>'
            '<div id="api">Reading the description …</div></main></body></html>'
        )


def answer_errors(app: FastAPI) -> None:
    """Have the app answer a refusal by its message."""
    for kind in (PrintctlError, LinkError, ProfileError, DesignError, RegistrationError):
        app.add_exception_handler(kind, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(OSError, _system)
    app.add_exception_handler(MemoryError, _system)
    app.add_exception_handler(Exception, _own)


def answer_unknown(app: FastAPI) -> None:
    """Have the app refuse whatever else is asked of the API, before its pages answer it."""
    methods = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"]

    @app.api_route(f"{API}/{{rest:path}}", methods=methods, include_in_schema=False)
    def unknown(request: Request) -> JSONResponse:
        what = f"{request.method} {request.url.path}"
        raise NotFoundError(f"the API has no {what}; /api/docs lists what it has")


async def _refused(request: Request, exc: Exception) -> JSONResponse:
    return error_response(getattr(exc, "status", _CONFLICT), str(exc), type(exc).__name__)


async def _invalid(request: Request, exc: Exception) -> JSONResponse:
    problems = exc.errors() if isinstance(exc, RequestValidationError) else []
    message = "; ".join(map(_sentence, problems)) or "the request can't be read"
    return error_response(422, message, "BadRequestError")


def _sentence(problem: Mapping[str, Any]) -> str:
    """One wrong value of a request: its place, what it must be, and what it is."""
    place, value = ".".join(map(str, problem["loc"])), repr(problem.get("input"))
    if problem["type"] == "missing":
        return f"{place} is missing; add it"
    shown = value if len(value) <= _LONGEST_VALUE else f"{value[:_LONGEST_VALUE]}..."
    return f"{place} {wording(problem)} (is {shown})"


async def _system(request: Request, exc: Exception) -> JSONResponse:
    """Answer what the system refused: a full disk, rights, too many files, memory."""
    log.error("%s %s: %r", request.method, request.url.path, exc)
    assert isinstance(exc, OSError | MemoryError)
    explained = explain(exc)
    return error_response(explained.status, explained.message, explained.kind)


async def _own(request: Request, exc: Exception) -> JSONResponse:
    """Answer a fault of ours; the server writes its trace into the log."""
    text = f"the server met an error of its own ({type(exc).__name__}); its log has the details"
    return error_response(500, text, "ServerError")


async def _http(request: Request, exc: Exception) -> JSONResponse:
    assert isinstance(exc, HTTPException)
    if isinstance(exc.__cause__, OSError):  # an upload that couldn't be kept while it came
        return await _system(request, exc.__cause__)
    names = {404: "NotFoundError", 405: "MethodNotAllowed"}
    name = names.get(exc.status_code, "HTTPException")
    answer = error_response(exc.status_code, str(exc.detail), name)
    answer.headers.update(exc.headers or {})
    return answer


class Health(BaseModel):
    """That the server lives."""

    ok: bool = True
    version: str


class ControlsState(BaseModel):
    """Who holds the controls, and who asks."""

    holder: Principal | None
    you: Principal


class ControlRequest(BaseModel):
    """A request for the controls."""

    force: bool = Field(False, description="take them from whoever holds them")


class StopAnswer(BaseModel):
    """What went out. How each ended comes as an event."""

    sent: list[SentStop]
    message: str
    rehearsals_ended: int = 0


def router(core: Core, prints: PrintSockets, end_rehearsals: Callable[[], int]) -> APIRouter:
    """Routes that belong to no room; a stop ends what is on its way to a simulated print, too."""
    routes = APIRouter(prefix=API, tags=["server"], responses=REFUSALS)

    @routes.get("/health", summary="Whether the server lives; open to all")
    def health() -> Health:
        return Health(version=version())

    @routes.get("/controls", summary="Who holds the controls")
    def holder(who: Asking) -> ControlsState:
        return ControlsState(holder=core.controls.holder, you=who)

    @routes.post("/controls", summary="Take the controls, or take them over")
    def take(who: Asking, request: ControlRequest | None = None) -> ControlsState:
        core.controls.take(who, force=request is not None and request.force)
        publish_holder(core)
        return holder(who)

    @routes.delete("/controls", summary="Release the controls")
    def release(who: Asking) -> ControlsState:
        core.controls.release(who)
        publish_holder(core)
        return holder(who)

    @routes.post(
        "/stop", summary="Emergency stop of every printer, past all queues; needs no controls"
    )
    async def stop() -> StopAnswer:
        sent = await prints.kill(time.monotonic())
        ending = asyncio.create_task(asyncio.to_thread(end_rehearsals))
        outcomes = await prints.outcomes(sent)
        unconfirmed = any("cut its power" in one["message"].lower() for one in outcomes)
        machines = len({one.process or one.folder for one in sent})
        message = (
            f"emergency stop sent to {machines} printer{'s' if machines > 1 else ''}; "
            + (f"{UNCONFIRMED}; " if unconfirmed else "")
            + "each status tells whether it has halted; positions are unknown now"
            if sent
            else "no printer is connected here: nothing to halt; if something moves, cut its power"
        )
        await asyncio.wait({ending}, timeout=_REHEARSALS_END_S)
        ended = 0 if not ending.done() or ending.exception() else ending.result()
        return StopAnswer(sent=sent, message=message, rehearsals_ended=ended)

    @routes.websocket("/events")
    async def events(socket: WebSocket) -> None:
        await socket.accept()
        work = [_tell(core, socket), _beat(core, socket), _until_gone(socket)]
        tasks = [asyncio.create_task(one) for one in work]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    return routes


def publish_holder(core: Core) -> None:
    """Tell all who holds the controls, if they don't know yet."""
    holder = core.controls.holder
    public = holder and asdict(holder)
    if "controls" not in core.events.latest or core.events.latest["controls"]["holder"] != public:
        core.events.publish("controls", holder=public)


async def watch_holder(core: Core, every_s: float = 1.0) -> None:
    """Tell when the controls fall free or change hands otherwise."""
    while True:
        publish_holder(core)
        await asyncio.sleep(every_s)


async def _tell(core: Core, socket: WebSocket) -> None:
    async for message in core.events.listen():
        await socket.send_json(message)


async def _beat(core: Core, socket: WebSocket) -> None:
    who = requesting_user(socket)
    while True:
        core.controls.seen(who)
        await socket.send_json({"event": "alive", "you": asdict(who)})
        await asyncio.sleep(BEAT_S)


async def _until_gone(socket: WebSocket) -> None:
    async for _ in socket.iter_text():
        pass
