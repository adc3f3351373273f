"""The server's parts put together: rooms, API, pages."""

from __future__ import annotations

from fastapi import FastAPI

from printctl.web.core import Core

API = "/api/v1"


def build_app(core: Core) -> FastAPI:
    """Make the app of one server.

    Parameters
    ----------
    core : Core
    """
    return FastAPI(
        title="printctl", docs_url=None, redoc_url=None, openapi_url=f"{API}/openapi.json"
    )
