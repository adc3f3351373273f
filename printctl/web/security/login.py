"""Log-in page, and the routes that check the password and log out."""

from __future__ import annotations

import hmac
from html import escape
from typing import Annotated, Final

from fastapi import APIRouter, Form, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from printctl.web.security.guard import Guard, log, start_session, too_often
from printctl.web.shell.assets import FOLDER, link

_HOME: Final = "/printer"
_LONGEST: Final = 1024


def router() -> APIRouter:
    """Return ``/login`` and ``/logout``, in the event loop: no two guesses count as one."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/login")
    async def ask(request: Request, next: str = _HOME) -> Response:  # noqa: A002 (the field's name)
        return _page(request.state.guard, next)

    @routes.post("/login")
    async def enter(
        request: Request,
        password: Annotated[str, Form(max_length=_LONGEST)],
        next: Annotated[str, Form()] = _HOME,  # noqa: A002
    ) -> Response:
        guard: Guard = request.state.guard
        address = request.client.host if request.client else ""
        wait, right = guard.passwords.wait_s(address), guard.settings.password
        if wait:
            answer: Response = too_often(wait)
            if "text/html" in request.headers.get("accept", ""):
                answer = _page(guard, next, f"Too many attempts. Try again in {wait} s.", 429)
                answer.headers["retry-after"] = str(wait)
            return answer
        if right is None or not hmac.compare_digest(password.encode(), right.encode()):
            guard.passwords.failed(address)
            log.warning("wrong password from %s", address)
            return _page(guard, next, "Wrong password.", 401)
        start_session(request.session)
        return RedirectResponse(_inside(next), 303)

    @routes.post("/logout")
    async def leave(request: Request) -> Response:
        request.state.guard.log_out(request.session)
        return RedirectResponse("/login", 303)

    return routes


def _inside(way: str) -> str:
    """Return a way on this server; anything else could lead to another."""
    bad = not way.startswith("/") or way[1:2] in ("/", "\\") or not way.isprintable()
    return _HOME if bad else way


def _page(guard: Guard, way: str, problem: str = "", status: int = 200) -> HTMLResponse:
    note = f'<p class="pc-login-note" role="alert">{escape(problem)}</p>' if problem else ""
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
            f'value="{escape(_inside(way))}"><label for="password">Password</label>'
            '<input id="password" name="password" type="password" required autofocus '
            'autocomplete="current-password"><button class="pc-button">Log in</button></form>'
        )
    page = (FOLDER / "login.html").read_text(encoding="utf-8").replace("<!--note-->", note)
    page = page.replace("<!--style-->", link("shell.css")).replace("<!--form-->", form)
    return HTMLResponse(page, status)
