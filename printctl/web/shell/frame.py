"""Frame of every web page: header, navigation, stop button.

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

BLUE: Final = "#0b5cad"
"""Of filled buttons: white on it has a contrast of 6.6 : 1, in light and dark."""


@contextmanager
def frame(path: str) -> Iterator[None]:
    """Put what is made inside below the header of the page at ``path``, as its content.

    The page's name is its h1; headings inside begin with h2.
    """
    name = PAGES[path]
    guard = getattr(ui.context.client.request.state, "guard", None)
    ui.colors(primary=BLUE)
    ui.page_title(f"{name} · printctl")
    ui.add_head_html(head(guard.stop_port if guard else 0))
    ui.add_body_html(header(path, leave=guard is not None and not guard.settings.open))
    with ui.element("div").classes("pc-content").props("id=content tabindex=-1"):
        ui.html(escape(name), tag="h1", sanitize=False).classes("pc-title")
        yield


def head(stop_port: int) -> str:
    """Style and scripts; the stop's is among the first, and none waits for NiceGUI's.

    Parameters
    ----------
    stop_port : int
        Of the stop process; 0 for none.
    """
    door = f'<meta name="printctl-stop-port" content="{stop_port}">\n' if stop_port else ""
    return (
        f'{door}<link rel="stylesheet" href="{link("utilities.css")}">\n'
        f'<link rel="stylesheet" href="{link("shell.css")}">\n'
        f'<script src="{link("theme.js")}"></script>\n'
        f'<script src="{link("stop.js")}"></script>\n'
        f'<script src="{link("shell.js")}" defer></script>'
    )


def header(path: str, leave: bool) -> str:
    """The header's HTML, with the page at ``path`` marked as the current one.

    Parameters
    ----------
    path : str
    leave : bool
        Whether it has a button to log out.
    """
    ways = "".join(
        f'<a href="{way}"{_CURRENT if path == way else ""}>{escape(name)}</a>'
        for way, name in PAGES.items()
    )
    whole = (FOLDER / "header.html").read_text(encoding="utf-8").replace("<!--ways-->", ways)
    return whole.replace("<!--leave-->", _LEAVE if leave else "")


_CURRENT: Final = ' aria-current="page"'
_LEAVE: Final = (
    '<form method="post" action="/logout">'
    '<button class="pc-button" type="submit">Log out</button></form>'
)
