"""The frame of every page: header, ways between the pages, the red stop."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from nicegui import ui

PAGES: Final = {
    "/printer": "Printer",
    "/job": "Job",
    "/design": "Design",
    "/scan": "Scan",
    "/history": "History",
}


@contextmanager
def frame(path: str) -> Iterator[None]:
    """Put what is made inside between header and footer of the page at ``path``."""
    ui.page_title(f"{PAGES[path]} · printctl")
    with ui.header().classes("items-center"):
        for way, name in PAGES.items():
            ui.link(name, way).classes("text-white q-px-sm")
        ui.space()
        ui.button("Stop", color="red")
    with ui.element("main").classes("w-full"):
        yield
