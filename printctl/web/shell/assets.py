"""Serve the style sheets and scripts shared by all pages; give their versioned addresses."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from fastapi import FastAPI
from starlette.staticfiles import StaticFiles

URL: Final = "/static/shell"
FOLDER: Final = Path(__file__).with_name("static")


def serve_assets(app: FastAPI) -> None:
    """Have the app serve them."""
    app.mount(URL, StaticFiles(directory=FOLDER), name="shell")


def link(name: str) -> str:
    """Address of a file; it changes when the file does, so that no browser keeps an old one."""
    return f"{URL}/{name}?v={int((FOLDER / name).stat().st_mtime)}"
