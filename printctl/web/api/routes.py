"""Health, news and the controls."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect

from printctl.web.core import Core

API = "/api/v1"


def router(core: Core) -> APIRouter:
    """Routes that belong to no room."""
    routes = APIRouter(prefix=API)

    @routes.get("/health")
    def health() -> dict[str, Any]:
        return {"ok": True}

    @routes.websocket("/events")
    async def events(socket: WebSocket) -> None:
        await socket.accept()
        try:
            async for message in core.events.listen():
                await socket.send_json(message)
        except WebSocketDisconnect:
            return

    return routes
