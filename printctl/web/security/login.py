"""Log-in page, and the routes that check the password and log out."""

from __future__ import annotations

from html import escape
from typing import Annotated, Final

from fastapi import APIRouter, Form, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from printctl.web.security.guard import Guard, log, too_often
from printctl.web.shell.assets import link

_HOME: Final = "/printer"
_LONGEST: Final = 1024


def router() -> APIRouter:
    """``/login`` and ``/logout``."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/login")
    def ask(request: Request, next: str = _HOME) -> Response:  # noqa: A002 (the field's name)
        return _page(request.state.guard, _inside(next))

    @routes.post("/login")
    def enter(
        request: Request,
        password: Annotated[str, Form(max_length=_LONGEST)],
        next: Annotated[str, Form()] = _HOME,  # noqa: A002
    ) -> Response:
        guard: Guard = request.state.guard
        address = request.client.host if request.client else ""
        wait = guard.gate.throttle.wait_s(address)
        if wait:
            answer = _page(guard, _inside(next), f"Too many attempts. Try again in {wait} s.", 429)
            answer.headers["Retry-After"] = str(wait)
            return answer if _wants_page(request) else too_often(wait)
        if not guard.gate.is_password(password):
            guard.gate.throttle.failed(address)
            log.warning("wrong password from %s", address)
            return _page(guard, _inside(next), "Wrong password.", 401)
        guard.gate.throttle.succeeded(address)
        entered = RedirectResponse(_inside(next), 303)
        guard.set_cookie(entered, guard.gate.sessions.issue())
        return entered

    @routes.post("/logout")
    async def leave(request: Request) -> Response:  # in the loop: it wakes WebSockets up
        guard: Guard = request.state.guard
        if request.state.session is not None:
            guard.logged_out(request.state.session)
        left = RedirectResponse("/login", 303)
        guard.set_cookie(left, "")
        return left

    return routes


def _inside(way: str) -> str:
    """A way on this server; anything else could lead to another."""
    bad = not way.startswith("/") or way[1:2] in ("/", "\\") or not way.isprintable()
    return _HOME if bad else way


def _wants_page(request: Request) -> bool:
    return "text/html" in request.headers.get("accept", "")


def _page(guard: Guard, way: str, problem: str = "", status: int = 200) -> HTMLResponse:
    note = f'<p class="pc-login-note" role="alert">{escape(problem)}</p>' if problem else ""
    if guard.gate.password is None:
        form = (
            "<p>This page is opened by the link that <code>printctl serve</code> printed when it "
            "started.</p>"
            if not guard.gate.open
            else f'<p>You are logged out. <a href="{_HOME}">Open the page again</a></p>'
        )
    else:
        form = (
            f'<form method="post" action="/login"><input type="hidden" name="next" '
            f'value="{escape(way)}"><label for="password">Password</label>'
            '<input id="password" name="password" type="password" required autofocus '
            'autocomplete="current-password"><button class="pc-button">Log in</button></form>'
        )
    return HTMLResponse(
        '<!doctype html><html lang="en"><head><title>Log in · printctl</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="stylesheet" href="{link("shell.css")}"></head>'
        f'<body><main class="pc-login"><h1>printctl</h1>{note}{form}</main></body></html>',
        status,
    )
