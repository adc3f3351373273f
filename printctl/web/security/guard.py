"""Access guard: middleware that authorises every HTTP and WebSocket request.

In this order: the ``Host`` must be ours; what changes something must come from our own page, or
from what isn't a page of another; there must be a session or a token. On the loopback a visit of
a page gets a session without log-in, unless a password is set.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import secrets
import time
from collections import deque
from html import escape
from typing import Any, Final
from urllib.parse import quote, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.middleware.sessions import SessionMiddleware
from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from printctl.machine.records.actor import ACTOR
from printctl.web.controls import Principal
from printctl.web.rest import error_response
from printctl.web.security.access import LIFETIME_S, Access, bearer, doubled
from printctl.web.security.uploads import limit_body
from printctl.web.settings import ServeSettings

log = logging.getLogger("printctl.web")

RENEW_S: Final = 1800
"""A cookie older than this is renewed at the next request."""
_PUBLIC: Final = re.compile(r"/login|/favicon\.ico|/api/v1/health|/static/page/.*")
"""What anybody may ask for who reaches the server; nothing in it is the user's."""
_NO_PAGES: Final = ("/api/", "/static/")
_CLOSED: Final[Message] = {"type": "websocket.close", "code": 4403, "reason": "not allowed"}
_BROWSERS: Final = {
    "Edg": "Edge", "OPR/": "Opera", "Firefox": "Firefox", "Chrom": "Chrome", "Safari": "Safari",
}  # fmt: skip
_SYSTEMS: Final = ("Android", "iPhone", "iPad", "Windows", "Macintosh", "CrOS", "Linux")
_HEADERS: Final = {
    "x-content-type-options": "nosniff",
    # No word to other servers; without any, a browser would call our own forms' origin "null".
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "x-frame-options": "DENY",
    "permissions-policy": "geolocation=(), microphone=(), payment=()",
}
# Scripts and styles come only from our own files: one in a file name or a G-code comment that
# slipped into a page as HTML would not run. Views of runs say a policy of their own.
_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "media-src 'self' blob:; font-src 'self' data:; worker-src 'self' blob:; "
    "connect-src 'self' {sources}; form-action 'self'; base-uri 'none'; "
    "frame-src 'self'; frame-ancestors 'none'; object-src 'none'"
)


class RefusedError(Exception):
    """The guard's answer in place of the app's."""

    def __init__(self, answer: Response) -> None:
        super().__init__(answer.status_code)
        self.answer = answer


def refused(status: int, message: str, error: str = "NotAllowedError") -> RefusedError:
    """Return a refusal with a message."""
    return RefusedError(error_response(status, message, error))


class Guard:
    """Access guard middleware around ``app``; ``stop_port`` is 0 without a stop process."""

    def __init__(
        self, app: ASGIApp, access: Access, settings: ServeSettings, stop_port: int = 0
    ) -> None:
        self.access, self.settings, self.stop_port = access, settings, stop_port
        self.wrong_passwords: deque[tuple[float, str]] = deque(maxlen=10_000)
        self._app = app
        self._sockets: dict[str, set[asyncio.Future[None]]] = {}
        self._sessions = SessionMiddleware(
            self._authorise, access.secret, access.cookie, LIFETIME_S, "/", "strict",
            https_only=settings.tls,
        )  # fmt: skip

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, as ASGI has it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers, scheme = Headers(scope=scope), self.settings.scheme
        host = self.access.host(headers)
        sources = f"{scheme.replace('http', 'ws')}://{headers['host']}" if host else ""
        sources += f" {scheme}://{host}:{self.stop_port}" if host and self.stop_port else ""
        scope = {**scope, "state": {**scope.get("state", {}), "guard": self}}
        await self._sessions(scope, receive, _dressed(send, _POLICY.format(sources=sources)))

    def log_out(self, session: dict[str, Any]) -> None:
        """End a session: its cookie is void, its WebSockets are closed."""
        if "id" in session:
            self.access.revoke(session["id"])
            for task in self._sockets.pop(session["id"], set()):
                task.cancel()
        session.clear()

    async def _authorise(self, scope: Scope, receive: Receive, send: Send) -> None:
        asking = HTTPConnection(scope)
        if "id" in asking.session and self.access.is_revoked(asking.session["id"]):
            asking.session.clear()
        try:
            scope["state"]["principal"] = self._principal(asking)
            if scope["type"] == "http":
                receive = limit_body(scope, receive, int(self.settings.upload_mb * 1e6))
        except RefusedError as exc:
            await exc.answer(scope, receive, send)
        except HTTPException as exc:
            answer = error_response(exc.status_code, str(exc.detail), "TooLargeError")
            await answer(scope, receive, send)
        else:
            if scope["state"]["principal"] is not None:
                ACTOR.set(scope["state"]["principal"].actor)
                if "know" in scope["state"]:
                    scope["state"]["know"]()
            if scope["type"] == "websocket" and "id" in asking.session:
                await self._until_logged_out(asking.session["id"], scope, receive, send)
            else:
                await self._app(scope, receive, send)

    def _principal(self, asking: HTTPConnection) -> Principal | None:
        """Return who asks; None for anybody, who may see the log-in page.

        Raises
        ------
        RefusedError
        """
        if reason := doubled(asking.headers):
            raise refused(400, reason, "BadRequestError")
        if self.access.host(asking.headers) is None:
            text = (
                f"host {asking.headers.get('host', '')[:80]!r} isn't a name of this server; use "
                "its address, or name it by `printctl serve --name`"
            )
            raise refused(421, text)
        session, path = asking.session, asking.scope["path"]
        token, for_page = bearer(asking.headers), _is_for_page(asking)
        self._check_origin(asking, token, for_page)
        if token is not None:
            self._check_token(asking, token, "wrong token; it stands in .printctl/serve.json")
            return Principal("script", f"a script at {_address(asking) or 'this machine'}")
        if "token" in asking.query_params and for_page:
            if "id" not in session:
                link = asking.query_params["token"]
                self._check_token(asking, link, "the link's token is wrong: it is of another start")
                start_session(session)
            raise RefusedError(RedirectResponse(_here(asking, without="token"), 303))
        if "id" in session:
            if time.time() - session["at"] > RENEW_S:
                session["at"] = int(time.time())
            return _browser(asking)
        if _PUBLIC.fullmatch(path):
            return None
        if not for_page:
            text = "no session: open the page first, or send `Authorization: Bearer TOKEN`"
            raise refused(401, text)
        if asking.headers.get("sec-fetch-site") in ("cross-site", "same-site"):
            # A strict cookie isn't sent along a link of another site: ask once more, from here.
            again = escape(_here(asking))
            raise RefusedError(
                HTMLResponse(
                    '<!doctype html><html lang="en"><title>printctl</title>'
                    f'<meta http-equiv="refresh" content="0;url={again}">'
                    f'<a href="{again}">printctl</a>'
                )
            )
        if not self.settings.open:
            raise RefusedError(RedirectResponse(f"/login?{urlencode({'next': path})}", 303))
        start_session(session)
        return _browser(asking)

    def _check_origin(self, asking: HTTPConnection, token: str | None, for_page: bool) -> None:
        origin, site = asking.headers.get("origin"), asking.headers.get("sec-fetch-site", "")
        if asking.scope.get("method") in ("GET", "HEAD", "OPTIONS"):
            if site in ("cross-site", "same-site") and not for_page:
                raise refused(403, "asked for by a page of another origin")
            return
        if origin is not None:
            page = f"{self.settings.scheme}://{asking.headers['host']}"
            ours = origin.lower() == page.lower()
        else:  # a browser tells one or the other; what isn't one shows a token
            ours = site == "same-origin" or (not site and token is not None)
        if not ours:
            who = f"origin {origin[:80]!r} isn't" if origin is not None else "no origin that is"
            raise refused(403, f"{who} this server's own page; scripts send a token")

    def _check_token(self, asking: HTTPConnection, shown: str, message: str) -> None:
        if not self.access.is_token(shown):
            log.warning("wrong token from %s", _address(asking))
            raise refused(401, message)

    async def _until_logged_out(
        self, session: str, scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Run a WebSocket, which log-out ends."""
        task = asyncio.ensure_future(self._app(scope, receive, send))
        self._sockets.setdefault(session, set()).add(task)
        await asyncio.wait({task})
        if session in self._sockets:
            self._sockets[session].discard(task)
            task.result()
        else:
            with contextlib.suppress(RuntimeError):  # closed by the app, or gone by itself
                await send(_CLOSED)


def start_session(session: dict[str, Any], user: str = "") -> None:
    """Begin a new session, which the answer's cookie hands out."""
    session.clear()
    session.update(id=secrets.token_hex(16), at=int(time.time()), user=user)


def _is_for_page(asking: HTTPConnection) -> bool:
    """Return whether a browser asks for a page to show."""
    scope = asking.scope
    if scope.get("method") != "GET" or scope["path"].startswith(_NO_PAGES):
        return False
    return asking.headers.get("sec-fetch-mode", "navigate") == "navigate"


def _here(asking: HTTPConnection, without: str = "") -> str:
    """Return the address asked for; two slashes at its beginning would lead to another server."""
    query = [(name, value) for name, value in asking.query_params.multi_items() if name != without]
    return "/" + quote(asking.scope["path"]).lstrip("/") + (f"?{urlencode(query)}" if query else "")


def _address(asking: HTTPConnection) -> str:
    return asking.client.host if asking.client else ""


def _browser(asking: HTTPConnection) -> Principal:
    """Return a browser's session, in words: ``Chrome on Android at 192.168.1.7 (4f2)``."""
    agent, address, session = asking.headers.get("user-agent", ""), _address(asking), asking.session
    name = next((said for sign, said in _BROWSERS.items() if sign in agent), "a browser")
    system = next((one for one in _SYSTEMS if one in agent), "").replace("Macintosh", "Mac")
    where = "this machine" if address.startswith(("127.", "::1")) else address
    name += f"{' on ' + system if system else ''} at {where or 'an unknown address'}"
    user = session.get("user", "")
    name = f"{user}, {name}" if user else name
    return Principal(session["id"], f"{name} ({session['id'][:3]})", user)


def _dressed(send: Send, policy: str) -> Send:
    """Return a ``send`` that adds the security headers.

    A refusal in plain text, as libraries write them, becomes one in JSON as ours.
    """
    plain: Message = {}

    async def dressed(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(raw=list(message["headers"]))
            for name, value in {**_HEADERS, "content-security-policy": policy}.items():
                headers.setdefault(name, value)
            message = {**message, "headers": headers.raw}
            text = headers.get("content-type", "").startswith("text/plain")
            if text and message["status"] >= 400:
                plain.update(message)
                return
        elif plain:
            reason = message.get("body", b"").decode(errors="replace")
            answer = error_response(plain["status"], reason, "BadRequestError")
            MutableHeaders(scope=plain).update(answer.headers)
            await send(plain)
            message = {**message, "body": answer.body}
        await send(message)

    return dressed
