"""Serve the page: its HTML at each of its addresses, its scripts, styles and pictures."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from fastapi import FastAPI, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

URL: Final = "/static/page"
FOLDER: Final = Path(__file__).with_name("static")
_ROOMS: Final = ("project", "printer", "commission", "job", "design", "scan", "history")
ADDRESSES: Final = {"/": "home"} | {f"/{room}": room for room in _ROOMS}
"""Where the page is, and the module in ``static/pages`` that draws it there."""
_FIRST: Final = (
    *("vendor/preact.js", "vendor/hooks.js", "vendor/htm.js"),
    *("api.js", "ui.js", "header.js"),
)
_LEAVE: Final = (
    '<form method="post" action="/logout">'
    '<button class="button" type="submit">Log out</button></form>'
)


@cache
def version() -> str:
    """A name for the files as they are; another when one of them changes."""
    whole = hashlib.sha256()
    for path in sorted(FOLDER.rglob("*")):
        if path.is_file():
            whole.update(path.relative_to(FOLDER).as_posix().encode() + path.read_bytes())
    return whole.hexdigest()[:12]


def link(name: str) -> str:
    """Address of a file, which a browser may keep for ever."""
    return f"{URL}/{version()}/{name}"


class _Kept(StaticFiles):
    """Files below a folder named by their version, kept by browsers for a year."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        first, _, rest = path.partition("/")
        answer = await super().get_response(rest if first == version() else path, scope)
        if first == version() and answer.status_code == 200:
            answer.headers["cache-control"] = "private, max-age=31536000, immutable"
        return answer


Hints = Callable[[Request], str]
"""Gives HTML for the head of a page, by its address: what the browser is to fetch at once."""


def serve_files(app: FastAPI) -> None:
    """Have the app serve the page's scripts, styles and pictures, which log-in takes, too."""
    app.mount(URL, _Kept(directory=FOLDER), name="page")


def serve_page(app: FastAPI, hints: Mapping[str, Hints]) -> None:
    """Have the app serve the page at its addresses; ``hints`` by the page's module."""
    for address, module in ADDRESSES.items():
        app.add_api_route(address, _page_at(module, hints.get(module)), include_in_schema=False)

    @app.get("/history/{print_id}", include_in_schema=False)
    def moved(print_id: str) -> RedirectResponse:
        """An address of before 0.1.0, kept in people's bookmarks."""
        return RedirectResponse(f"/history?print={quote(print_id)}", 308)


def _page_at(module: str, hints: Hints | None) -> Any:
    def page(request: Request) -> HTMLResponse:
        guard = getattr(request.state, "guard", None)
        port = guard.stop_port if guard else 0
        leave = guard is not None and not guard.settings.open
        return HTMLResponse(_html(module, port, leave, hints(request) if hints else ""))

    return page


def _html(module: str, stop_port: int, leave: bool, hints: str) -> str:
    """Return the page's HTML, with a button to log out if ``leave`` and ``hints`` in the head.

    With the first scripts the browser fetches the ``module`` of ``static/pages``, the modules that
    it is made of (``MODULE_*.js``) and its style sheet. ``stop_port`` is 0 without a stop process.
    """
    own = [f"pages/{path.name}" for path in sorted((FOLDER / "pages").glob(f"{module}*"))]
    modules = [*_FIRST, *(name for name in own if name.endswith(".js"))]
    styles = [name for name in own if name.endswith(".css")]
    parts = {
        "folder": f"{URL}/{version()}",
        "door": f'<meta name="printctl-stop-port" content="{stop_port}">' if stop_port else "",
        "preload": "".join(f'<link rel="stylesheet" href="{link(name)}">' for name in styles)
        + "".join(f'<link rel="modulepreload" href="{link(name)}">' for name in modules)
        + hints,
        "leave": _LEAVE if leave else "",
    }
    text = (FOLDER / "index.html").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(f"<!--{name}-->", part)
    return text
