"""Stand-alone live view page, for tests and benchmarks."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi.responses import HTMLResponse

from printctl.web.live import JobSource
from printctl.web.live.routes import SceneMaker, router

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


def application(jobs: Mapping[str, JobSource]) -> FastAPI:
    """Pages at ``/{job}``; their options come from the query."""
    maker = SceneMaker()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        await maker.start()
        yield
        await maker.close()

    app = FastAPI(lifespan=lifespan)
    app.include_router(router(jobs.__getitem__, maker))

    @app.get("/job/{job}", response_class=HTMLResponse)
    async def page(job: str, live: bool = False, plain: bool = False) -> str:
        options = {"scene": f"/live/{job}/scene", "live": live, "plain": plain}
        return PAGE.format(options=json.dumps(options))

    return app
