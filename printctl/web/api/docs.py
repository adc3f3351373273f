"""Serve an offline HTML page at /api/docs that shows the OpenAPI description."""

from __future__ import annotations

from fastapi import FastAPI
from starlette.responses import HTMLResponse

from printctl.web.api.answers import API
from printctl.web.shell.assets import link


def serve_docs(app: FastAPI) -> None:
    """Have the app show its API at ``/api/docs``."""

    @app.get("/api/docs", include_in_schema=False)
    def docs() -> HTMLResponse:
        return HTMLResponse(
            '<!doctype html><html lang="en"><head><title>API · printctl</title>'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<link rel="stylesheet" href="{link("shell.css")}">'
            f'<link rel="stylesheet" href="{link("api.css")}">'
            f'<script src="{link("api.js")}" defer></script></head>'
            f'<body><main class="pc-api" data-api="{API}/openapi.json">'
            '<h1>printctl: API</h1><p><a href="/printer">Back to the page</a></p>'
            '<div id="api">Reading the description …</div></main></body></html>'
        )
