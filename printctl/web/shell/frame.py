"""The frame of every page: header, ways between the pages, the red stop.

The header is plain HTML beside NiceGUI's app, with scripts of its own: it works when the app in
the page or its connection doesn't.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import Final

from nicegui import ui

from printctl.web.shell.assets import FOLDER, link

PAGES: Final = {
    "/printer": "Printer",
    "/job": "Job",
    "/design": "Design",
    "/scan": "Scan",
    "/history": "History",
}


@contextmanager
def frame(path: str) -> Iterator[None]:
    """Put what is made inside below the header of the page at ``path``, as its content.

    The page's name is its h1; the content begins with h2.
    """
    name = PAGES[path]
    ui.page_title(f"{name} · printctl")
    ui.add_head_html(head())
    ui.add_body_html(header(path))
    with ui.element("div").classes("pc-content").props("id=content tabindex=-1"):
        ui.html(escape(name), tag="h1", sanitize=False).classes("pc-title")
        yield


def head() -> str:
    """Style and scripts; the stop's is first, and none waits for NiceGUI's."""
    return (
        f'<link rel="stylesheet" href="{link("shell.css")}">\n'
        f'<script src="{link("stop.js")}"></script>\n'
        f'<script src="{link("shell.js")}" defer></script>'
    )


def header(path: str) -> str:
    """The header's HTML, with the page at ``path`` marked as the current one."""
    ways = "".join(
        f'<a href="{way}"{_CURRENT if path.startswith(way) else ""}>{escape(name)}</a>'
        for way, name in PAGES.items()
    )
    return (FOLDER / "header.html").read_text(encoding="utf-8").replace("<!--ways-->", ways)


_CURRENT: Final = ' aria-current="page"'
