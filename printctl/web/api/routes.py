"""REST routes for server health, user identity, control lock, emergency stop and event stream."""

from __future__ import annotations

import asyncio
import time
from dataclasses import asdict
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Request, WebSocket, WebSocketDisconnect
from pydantic import BaseModel, Field

from printctl.web.api.answers import API, REFUSALS, our_version
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.print_sockets import UNCONFIRMED, PrintSockets

BEAT_S: Final = 3.0
"""So often a listener hears that the server lives, even without news."""

_PATIENCE_S: Final = 2.5
"""As the stop process waits for the word that a printer has halted."""


class Health(BaseModel):
    """That the server lives."""

    ok: bool = True
    version: str


class ClientResponse(BaseModel):
    """A browser or script."""

    id: str
    name: str


class ControlsState(BaseModel):
    """Who holds the controls, and who asks."""

    holder: ClientResponse | None
    you: ClientResponse


class ControlRequest(BaseModel):
    """A request for the controls."""

    force: bool = Field(False, description="take them from whoever holds them")


class StopResult(BaseModel):
    """One print or station that was told to halt."""

    folder: str
    after_ms: float = Field(description="from the request to the byte in its socket, ms")
    process: int = Field(description="that speaks to the machine: one for a station and its print")


class StopAnswer(BaseModel):
    """What went out. How each ended comes as an event."""

    sent: list[StopResult]
    message: str


def requesting_user(request: Request) -> Principal:
    """Who asks, as the guard found out."""
    principal: Principal | None = getattr(request.state, "principal", None)
    return principal or Principal("local", "this process")


Asking = Annotated[Principal, Depends(requesting_user)]


def router(core: Core, prints: PrintSockets) -> APIRouter:
    """Routes that belong to no room."""
    routes = APIRouter(prefix=API, tags=["server"], responses=REFUSALS)

    @routes.get("/health", summary="Whether the server lives; open to all")
    def health() -> Health:
        return Health(version=our_version())

    @routes.get("/controls", summary="Who holds the controls")
    def holder(who: Asking) -> ControlsState:
        return _state(core, who)

    @routes.post("/controls", summary="Take the controls, or take them over")
    def take(who: Asking, request: ControlRequest | None = None) -> ControlsState:
        core.controls.take(who, force=request is not None and request.force)
        publish_holder(core)
        return _state(core, who)

    @routes.delete("/controls", summary="Release the controls")
    def release(who: Asking) -> ControlsState:
        core.controls.release(who)
        publish_holder(core)
        return _state(core, who)

    @routes.post("/stop", summary="Halt every printer past all queues; needs no controls")
    async def stop() -> StopAnswer:
        sent = await prints.kill(time.monotonic())
        outcomes = await prints.outcomes(sent, _PATIENCE_S)
        unconfirmed = any(one["message"] == UNCONFIRMED for one in outcomes)
        machines = len({one.process or one.folder for one in sent})
        message = (
            f"a halt to {machines} printer{'s' if machines > 1 else ''}; "
            + (f"{UNCONFIRMED}; " if unconfirmed else "")
            + "each status tells whether it has halted; positions are unknown now"
            if sent
            else "nothing is connected to a printer here: nothing to stop; if something moves, "
            "cut its power"
        )
        return StopAnswer(sent=[StopResult(**asdict(one)) for one in sent], message=message)

    @routes.websocket("/events")
    async def events(socket: WebSocket) -> None:
        await socket.accept()
        who: Principal = getattr(socket.state, "principal", None) or Principal("local")
        work = [_tell(core, socket), _beat(core, socket, who), _until_gone(socket)]
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
    public = None if holder is None else {"id": holder.id, "name": holder.name}
    if "controls" not in core.events.latest or core.events.latest["controls"]["holder"] != public:
        core.events.publish("controls", holder=public)


async def watch_holder(core: Core, every_s: float = 1.0) -> None:
    """Tell when the controls fall free or change hands otherwise."""
    while True:
        publish_holder(core)
        await asyncio.sleep(every_s)


def _state(core: Core, who: Principal) -> ControlsState:
    held = core.controls.holder
    return ControlsState(
        holder=None if held is None else ClientResponse(id=held.id, name=held.name),
        you=ClientResponse(id=who.id, name=who.name),
    )


async def _tell(core: Core, socket: WebSocket) -> None:
    async for message in core.events.listen():
        await socket.send_json(message)


async def _beat(core: Core, socket: WebSocket, who: Principal) -> None:
    beat: dict[str, Any] = {"event": "alive", "you": {"id": who.id, "name": who.name}}
    while True:
        core.controls.seen(who)
        await socket.send_json(beat)
        await asyncio.sleep(BEAT_S)


async def _until_gone(socket: WebSocket) -> None:
    try:
        while True:
            await socket.receive_text()
    except (WebSocketDisconnect, KeyError):
        return
