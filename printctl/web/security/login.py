"""Log-in page, and the routes that check the password and log out."""

from __future__ import annotations

import hmac
import math
import time
from asyncio import sleep
from collections.abc import Iterable
from html import escape
from typing import Annotated, Final

from fastapi import APIRouter, Form, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from printctl.web.page.assets import FOLDER, link
from printctl.web.security.guard import Guard, log, start_session

_HOME: Final = "/"
_LONGEST: Final = 1024
_LONGEST_NAME: Final = 80
MANY_OF_ONE: Final = 5
"""Wrong passwords a minute of one address, after which it waits."""
MANY: Final = 30
"""Of all addresses, after which each attempt takes `BRAKE_S` longer; nobody is locked out."""
BRAKE_S: Final = 1.0


def router() -> APIRouter:
    """Return ``/login`` and ``/logout``.

    They run in the event loop: between the count of guesses and the next one nothing is awaited.
    """
    routes = APIRouter(include_in_schema=False)

    @routes.get("/login")
    async def ask(request: Request, next: str = _HOME) -> Response:  # noqa: A002 (the field's name)
        return _page(request.state.guard, next)

    @routes.post("/login")
    async def enter(
        request: Request,
        password: Annotated[str, Form(max_length=_LONGEST)],
        user: Annotated[str, Form(max_length=_LONGEST_NAME)] = "",
        next: Annotated[str, Form()] = _HOME,  # noqa: A002
    ) -> Response:
        guard: Guard = request.state.guard
        address = request.client.host if request.client else ""
        wrong, right = guard.wrong_passwords, guard.settings.password
        if len(_last_minute(wrong)) >= MANY:
            await sleep(BRAKE_S)
        mine = _last_minute(wrong, address)
        if len(mine) >= MANY_OF_ONE:
            wait = math.ceil(mine[-MANY_OF_ONE] + 60.0 - time.monotonic())
            answer = _page(guard, next, f"Too many attempts. Try again in {wait} s.", 429)
            answer.headers["retry-after"] = str(wait)
            return answer
        if right is None or not hmac.compare_digest(password.encode(), right.encode()):
            wrong.append((time.monotonic(), address))
            log.warning("wrong password from %s", address)
            return _page(guard, next, "Wrong password.", 401)
        start_session(request.session, " ".join(user.split()))
        return RedirectResponse(_inside(next), 303)

    @routes.post("/logout")
    async def leave(request: Request) -> Response:
        request.state.guard.log_out(request.session)
        return RedirectResponse("/login", 303)

    return routes


def _last_minute(wrong: Iterable[tuple[float, str]], address: str = "") -> list[float]:
    """Return the times of the last minute's wrong passwords, of one address or of all."""
    now = time.monotonic()
    return [at for at, whose in wrong if now - at < 60.0 and address in ("", whose)]


def _inside(way: str) -> str:
    """Return a way on this server; anything else could lead to another."""
    bad = not way.startswith("/") or way[1:2] in ("/", "\\") or not way.isprintable()
    return _HOME if bad else way


def _page(guard: Guard, way: str, problem: str = "", status: int = 200) -> HTMLResponse:
    note = f'<p class="note note-warn" role="alert">{escape(problem)}</p>' if problem else ""
    if guard.settings.open:
        form = f'<p>You are logged out. <a href="{_HOME}">Open the page again</a></p>'
    elif guard.settings.password is None:
        form = (
            "<p>This page is opened by the link that <code>printctl serve</code> printed when it "
            "started.</p>"
        )
    else:
        form = (
            f'<form method="post" action="/login"><input type="hidden" name="next" '
            f'value="{escape(_inside(way))}"><label for="user">Your name, for '
            "the print's journal</label>"
            f'<input id="user" name="user" maxlength="{_LONGEST_NAME}" autocomplete="name">'
            '<label for="password">Password</label>'
            '<input id="password" name="password" type="password" required autofocus '
            'autocomplete="current-password">'
            '<button class="button button-main">Log in</button></form>'
        )
    page = (FOLDER / "login.html").read_text(encoding="utf-8").replace("<!--note-->", note)
    page = page.replace("<!--style-->", link("page.css")).replace("<!--form-->", form)
    return HTMLResponse(page, status)
