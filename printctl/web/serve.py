"""Serve the page: one process, until it is told to end."""

from __future__ import annotations

import os

import uvicorn

from printctl.web.core import Core
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace


def serve(settings: ServeSettings) -> None:
    """Serve until Ctrl-C."""
    workspace = Workspace(settings.workspace.resolve()).make()
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(workspace.private / "nicegui"))
    from printctl.web.app import build_app  # Loads NiceGUI, which reads the environment.

    app = build_app(Core(settings, workspace))
    uvicorn.run(app, host=settings.host, port=settings.port, proxy_headers=False)
