"""Stand-alone live view page, for tests and benchmarks."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from fastapi.responses import HTMLResponse

from printctl.web.live import JobSource
from printctl.web.live.maker_client import SceneMaker
from printctl.web.live.routes import router

PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Live view</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="stylesheet" href="/live/static/live_view.css"><link rel="icon" href="data:,">
<style>body {{ margin: 0; font: 15px/1.4 sans-serif; background: var(--paper); }}
:root {{ --paper: #fcfcfb }} @media (prefers-color-scheme: dark) {{ :root {{ --paper: #14171a }} }}
main {{ height: 100vh; box-sizing: border-box; padding: 12px; }}</style></head>
<body><main id="view"></main><script type="module">
import {{ liveView }} from "/live/static/live_view.js";
const view = await liveView(document.getElementById("view"), {options});
window.view = view;
</script></body></html>"""


@dataclass
class Prints:
    """What the page's WebSocket tells: each event goes to all who listen."""

    listeners: set[WebSocket] = field(default_factory=set)

    async def tell(self, said: Mapping[str, Any]) -> None:
        for one in list(self.listeners):
            await one.send_text(json.dumps(said))


def application(jobs: Mapping[str, JobSource], prints: Prints | None = None) -> FastAPI:
    """Pages at ``/{job}``; their options come from the query."""
    maker = SceneMaker()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        await maker.start()
        yield
        await maker.close()

    app = FastAPI(lifespan=lifespan)
    app.include_router(router(jobs.__getitem__, maker))
    told = prints or Prints()

    @app.get("/job/{job}", response_class=HTMLResponse)
    async def page(job: str, live: bool = False, plain: bool = False, source: str = "") -> str:
        options = {"scene": f"/live/{job}/scene", "live": live, "plain": plain}
        options |= {"source": source, "job": job}
        return PAGE.format(options=json.dumps(options))

    @app.websocket("/events")
    async def events(socket: WebSocket) -> None:
        await socket.accept()
        told.listeners.add(socket)
        try:
            while True:
                await socket.receive_text()
        except (WebSocketDisconnect, asyncio.CancelledError):
            told.listeners.discard(socket)

    @app.post("/tell")
    async def tell(said: dict[str, Any]) -> None:
        await told.tell(said)

    return app
